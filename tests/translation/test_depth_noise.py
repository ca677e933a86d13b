"""Noise of a depth camera: the range falls with the strength."""

import numpy as np
import pytest

from s2rtools.translation.depth_noise import BINS, DepthNoise

NOISE = DepthNoise(np.arange(BINS + 1.0), np.zeros(BINS), 0.0, max_depth=500.0)
DEPTH = np.linspace(1, 1001, 41 * 41).reshape(1, 41, 41).astype(np.uint16)


@pytest.mark.parametrize(("strength", "farthest"), [(0.0, 1001), (0.5, 750), (1.0, 500)])
def test_the_range_falls_from_the_farthest_pixel_to_that_of_the_camera(strength, farthest):
    degraded = NOISE.apply(DEPTH, np.ones(DEPTH.shape, dtype=bool), strength)
    np.testing.assert_array_equal(degraded == 0, farthest + 0.5 < DEPTH)
