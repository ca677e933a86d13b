"""The noise and the range of a depth sensor are estimated from pairs of images."""

from __future__ import annotations

import math

import numpy as np
import pytest

from s2rtools.counterfactual.depth_tolerance import DepthTolerance, estimate_tolerance


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
def test_noise_is_estimated(base: float, slope: float) -> None:
    found = estimate_tolerance(pairs(base, slope, 0, 99))
    for depth in (1.0, 3.0, 8.0):
        expected = base + slope * depth**2
        assert found.deviation(np.float32(depth)) == pytest.approx(expected, rel=0.25, abs=0.01)
    assert (found.near, found.far) == (0.0, math.inf)


def test_changed_surfaces_hardly_count() -> None:
    plain, changed = (estimate_tolerance(pairs(0.03, 0.01, 0, 99, share)) for share in (0, 0.15))
    at = np.float32(3.0)
    assert changed.deviation(at) == pytest.approx(plain.deviation(at), rel=0.4)


def test_the_range_is_estimated() -> None:
    found = estimate_tolerance(pairs(0.02, 0.01, 1.0, 6.0))
    assert found.near == pytest.approx(1.0, abs=0.15)
    assert found.far == pytest.approx(6.0, abs=0.15)
    assert found.in_range(np.array([0.5, 3.0, 7.0])).tolist() == [False, True, False]


@pytest.mark.parametrize("given", [[], [(np.zeros((4, 4), np.float32),) * 2]])
def test_without_depth_the_tolerance_is_finite(given: list) -> None:
    found = estimate_tolerance(given)
    assert found == DepthTolerance(0.05, 0.0, 0.0, math.inf, 0.0, 1.0)


def test_a_bias_of_the_sensor_is_no_change() -> None:
    biased = [(np.where(real > 0, 0.05 + 1.04 * real, 0).astype(np.float32), sim)
              for real, sim in pairs(0.02, 0.005, 0, 99)]  # fmt: skip
    found = estimate_tolerance(biased)
    assert found.shift == pytest.approx(0.05, abs=0.03)
    assert found.scale == pytest.approx(1.04, abs=0.01)
    depth = np.array([1.0, 4.0, 8.0], dtype=np.float32)
    assert found.expected(depth) == pytest.approx(0.05 + 1.04 * depth, abs=0.05)
    assert found.surface(found.expected(depth)) == pytest.approx(depth, abs=1e-4)
    assert found.deviation(depth) == pytest.approx(0.02 + 0.005 * depth**2, rel=0.3, abs=0.01)
