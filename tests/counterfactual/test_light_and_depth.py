"""Relighting, its compiled loops, and the estimated noise and range of a depth sensor."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rtools.counterfactual import light_grid
from s2rtools.counterfactual.depth_tolerance import DepthTolerance, estimate_tolerance
from s2rtools.counterfactual.relighting import relight
from s2rtools.synthetic_world.world import standard_camera
from tests.counterfactual.views import FRAME, SIZE, metres, rendered

ALL = np.ones(FRAME, np.float32)


def source(number: int = 1) -> tuple[np.ndarray, np.ndarray]:
    image = rendered("sim", standard_camera(SIZE))[number]
    return image[0].astype(np.float32), metres(image)


@settings(max_examples=15)
@given(st.floats(0.6, 1.1), st.floats(-15, 15), st.integers(0, 11))
def test_a_global_change_of_light_is_found(slope, offset, number):
    image, depth = source(number)
    target = np.clip(image * slope + offset, 0, 255)
    light = relight(image, target, depth, ALL)
    assert np.abs(light.image - target).mean() < 2.5
    assert light.spread < 3


def test_light_that_varies_over_the_image_is_found():
    image, depth = source()
    target = image * np.linspace(0.7, 1.0, SIZE, dtype=np.float32)[None, :, None]
    light = relight(image, target, depth, ALL)
    same_everywhere = light.slope * image + light.offset
    errors = [np.abs(each - target).mean() for each in (light.image, same_everywhere)]
    assert errors[0] < 0.7 * errors[1]


def test_changed_content_does_not_change_the_light():
    image, depth = source()
    target = image * np.float32(0.8)
    plain = relight(image, target, depth, ALL)
    changed = target.copy()
    changed[20:40, 20:40] = (250, 30, 30)
    light = relight(image, changed, depth, ALL)
    outside = np.ones(FRAME, bool)
    outside[18:42, 18:42] = False
    assert np.abs(light.image - plain.image)[outside].mean() < 1.5
    assert light.residual[24:36, 24:36].min() > 5 * max(light.spread, 1)


def test_the_light_can_be_taken_out_again():
    image, depth = source()
    light = relight(image, np.clip(image * 0.7 + 10, 0, 255), depth, ALL)
    lit = light.applied(image)
    inner = (lit > 1) & (lit < 254)
    assert np.abs(light.removed(lit) - image)[inner].max() < 0.1


def test_black_images_and_unknown_depth_have_a_finite_light():
    black = np.zeros((*FRAME, 3), np.float32)
    light = relight(black, black, np.zeros(FRAME, np.float32), 0 * ALL)
    assert np.isfinite(light.image).all()
    assert np.isfinite(light.removed(light.image)).all()


GRID = (6, 8, 5)
SHAPE = (24, 30)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def image(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0, 255, (*SHAPE, 3)).astype(np.float32)


def test_moments_are_weighted_means(rng):
    source, target = image(rng), image(rng)
    weights = rng.random(SHAPE).astype(np.float32)
    found = light_grid.weighted_moments(source, target, weights)
    for row, values in enumerate((source, target, source**2, source * target)):
        expected = np.average(values.reshape(-1, 3), axis=0, weights=weights.ravel())
        assert np.allclose(found[row], expected, rtol=1e-5)


def test_cells_are_summed(rng):
    lit, target = image(rng), image(rng)
    weights = rng.random(SHAPE).astype(np.float32)
    cell = rng.integers(0, np.prod(GRID), SHAPE).astype(np.int32)
    found = light_grid.cell_sums(cell, weights, lit, target, GRID)
    for sums, other in zip(found, (target, lit), strict=True):
        for channel in range(3):
            values = weights * lit[..., channel] * other[..., channel]
            expected = np.bincount(cell.ravel(), values.ravel(), np.prod(GRID))
            assert np.allclose(sums[..., channel].ravel(), expected, rtol=1e-4)


def test_a_grid_is_smoothed_along_each_axis(rng):
    grid = rng.random((*GRID, 3))
    expected = grid
    for axis in range(3):
        padded = np.pad(expected, [(int(a == axis),) * 2 for a in range(4)], mode="edge")
        before, at, after = (
            np.take(padded, np.arange(k, k + grid.shape[axis]), axis) for k in range(3)
        )
        expected = (before + 2 * at + after) / 4
    assert np.allclose(light_grid.smoothed(grid), expected)


def test_a_grid_is_sliced_linearly(rng):
    grid = rng.random((*GRID, 3)).astype(np.float32)
    level = rng.uniform(0, GRID[0] - 1, SHAPE).astype(np.float32)
    level[0, :2] = 0, GRID[0] - 1
    planes = np.stack(
        [cv2.resize(plane, SHAPE[::-1], interpolation=cv2.INTER_LINEAR) for plane in grid]
    )
    low = np.minimum(level.astype(int), GRID[0] - 2)
    rows, cols = np.ogrid[: SHAPE[0], : SHAPE[1]]
    share = (level - low)[..., None]
    expected = planes[low, rows, cols] * (1 - share) + planes[low + 1, rows, cols] * share
    assert np.allclose(light_grid.sliced(grid, level), expected, atol=1e-5)


def test_robust_weights_halve_at_the_limit():
    residual = np.array([[0.0, 4.0, 40.0]], np.float32)
    found = light_grid.robust_weights(np.full((1, 3), 0.5, np.float32), residual, np.float32(4))
    assert np.allclose(found, [[0.5, 0.25, 0.5 / 10_001]])


def pairs(base: float, slope: float, near: float, far: float, changed: float = 0.0) -> list:
    rng = np.random.default_rng(4)
    made = []
    for _ in range(8):
        sim = rng.uniform(0.5, 9.0, (60, 60)).astype(np.float32)
        noise = rng.standard_normal(sim.shape) * (base + slope * sim**2)
        real = (sim + noise).astype(np.float32)
        moved = rng.random(sim.shape) < changed
        real[moved] = rng.uniform(0.5, 9.0, moved.sum())
        real[(sim < near) | (sim > far)] = 0
        made.append((real, sim))
    return made


@pytest.mark.parametrize(("base", "slope"), [(0.02, 0.01), (0.05, 0.0), (0.03, 0.02)])
def test_noise_is_estimated(base, slope):
    found = estimate_tolerance(pairs(base, slope, 0, 99))
    for depth in (1.0, 3.0, 8.0):
        expected = base + slope * depth**2
        assert found.deviation(np.float32(depth)) == pytest.approx(expected, rel=0.25, abs=0.01)
    assert (found.near, found.far) == (0.0, math.inf)


def test_changed_surfaces_hardly_count():
    plain, changed = (estimate_tolerance(pairs(0.03, 0.01, 0, 99, share)) for share in (0, 0.15))
    at = np.float32(3.0)
    assert changed.deviation(at) == pytest.approx(plain.deviation(at), rel=0.4)


def test_the_range_is_estimated():
    found = estimate_tolerance(pairs(0.02, 0.01, 1.0, 6.0))
    assert found.near == pytest.approx(1.0, abs=0.15)
    assert found.far == pytest.approx(6.0, abs=0.15)
    assert found.in_range(np.array([0.5, 3.0, 7.0])).tolist() == [False, True, False]


@pytest.mark.parametrize("given", [[], [(np.zeros((4, 4), np.float32),) * 2]])
def test_without_depth_the_tolerance_is_finite(given):
    found = estimate_tolerance(given)
    assert found == DepthTolerance(0.05, 0.0, 0.0, math.inf, 0.0, 1.0)


def test_a_bias_of_the_sensor_is_no_change():
    biased = [(np.where(real > 0, 0.05 + 1.04 * real, 0).astype(np.float32), sim)
              for real, sim in pairs(0.02, 0.005, 0, 99)]  # fmt: skip
    found = estimate_tolerance(biased)
    assert found.shift == pytest.approx(0.05, abs=0.03)
    assert found.scale == pytest.approx(1.04, abs=0.01)
    depth = np.array([1.0, 4.0, 8.0], dtype=np.float32)
    assert found.expected(depth) == pytest.approx(0.05 + 1.04 * depth, abs=0.05)
    assert found.surface(found.expected(depth)) == pytest.approx(depth, abs=1e-4)
    assert found.deviation(depth) == pytest.approx(0.02 + 0.005 * depth**2, rel=0.3, abs=0.01)
