"""Compiled loops of relighting compared with plain numpy and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from s2rtools.counterfactual import light_grid

GRID = (6, 8, 5)
SHAPE = (24, 30)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def image(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0, 255, (*SHAPE, 3)).astype(np.float32)


def test_moments_are_weighted_means(rng: np.random.Generator) -> None:
    source, target = image(rng), image(rng)
    weights = rng.random(SHAPE).astype(np.float32)
    found = light_grid.weighted_moments(source, target, weights)
    for row, values in enumerate((source, target, source**2, source * target)):
        expected = np.average(values.reshape(-1, 3), axis=0, weights=weights.ravel())
        assert np.allclose(found[row], expected, rtol=1e-5)


def test_no_weight_gives_no_moments(rng: np.random.Generator) -> None:
    source = image(rng)
    assert not light_grid.weighted_moments(source, source, np.zeros(SHAPE, np.float32)).any()


def test_cells_are_summed(rng: np.random.Generator) -> None:
    lit, target = image(rng), image(rng)
    weights = rng.random(SHAPE).astype(np.float32)
    cell = rng.integers(0, np.prod(GRID), SHAPE).astype(np.int32)
    found = light_grid.cell_sums(cell, weights, lit, target, GRID)
    for sums, other in zip(found, (target, lit), strict=True):
        for channel in range(3):
            values = weights * lit[..., channel] * other[..., channel]
            expected = np.bincount(cell.ravel(), values.ravel(), np.prod(GRID))
            assert np.allclose(sums[..., channel].ravel(), expected, rtol=1e-4)


def test_a_grid_is_smoothed_along_each_axis(rng: np.random.Generator) -> None:
    grid = rng.random((*GRID, 3))
    expected = grid
    for axis in range(3):
        padded = np.pad(expected, [(int(a == axis),) * 2 for a in range(4)], mode="edge")
        before, at, after = (
            np.take(padded, np.arange(k, k + grid.shape[axis]), axis) for k in range(3)
        )
        expected = (before + 2 * at + after) / 4
    assert np.allclose(light_grid.smoothed(grid), expected)


def test_a_grid_is_sliced_linearly(rng: np.random.Generator) -> None:
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


def test_robust_weights_halve_at_the_limit() -> None:
    residual = np.array([[0.0, 4.0, 40.0]], np.float32)
    found = light_grid.robust_weights(np.full((1, 3), 0.5, np.float32), residual, np.float32(4))
    assert np.allclose(found, [[0.5, 0.25, 0.5 / 10_001]])


def test_differences_are_those_of_the_worst_channel(rng: np.random.Generator) -> None:
    a, b = image(rng), image(rng)
    assert np.array_equal(light_grid.largest_difference(a, b), np.abs(a - b).max(axis=2))
