"""Preprocessing of frames to the network input."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtools.models.preprocessing import preprocess, resize_frames


@pytest.fixture
def frames():
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (3, 16, 16, 3), dtype=np.uint8)
    return rgb, rng.integers(0, 256, (3, 16, 16), dtype=np.uint8)


def test_frames_of_the_input_size_are_only_scaled(frames):
    rgb, depth = frames
    x = preprocess(rgb, depth, 10 / 255, (16, 16))
    assert x.shape == (3, 4, 16, 16)
    assert x.dtype == np.float32
    np.testing.assert_allclose(x[:, :3], np.moveaxis(rgb / 127.5 - 1, -1, 1), atol=3e-7)
    np.testing.assert_allclose(x[:, 3], depth / 127.5 - 1, atol=3e-7)
    assert resize_frames(rgb, depth, (16, 16))[0] is rgb


def test_halving_averages_areas(frames):
    rgb, depth = frames
    small, small_depth = resize_frames(rgb, depth, (8, 8))
    means = rgb.astype(float).reshape(3, 8, 2, 8, 2, 3).mean(axis=(2, 4))
    assert small.dtype == np.uint8
    assert np.abs(small - means).max() <= 0.5
    assert np.abs(small_depth - depth.reshape(3, 8, 2, 8, 2).mean(axis=(2, 4))).max() <= 0.5
    np.testing.assert_array_equal(
        preprocess(rgb, depth, 0.01, (8, 8)), preprocess(small, small_depth, 0.01, (8, 8))
    )


def test_depth_in_millimetres_is_clipped_at_10_m():
    depth = np.array([[[0, 5000], [10000, 60000]]], dtype=np.uint16)
    x = preprocess(np.zeros((1, 2, 2, 3), np.uint8), depth, 0.001, (2, 2))
    np.testing.assert_allclose(x[0, 3], [[-1, 0], [1, 1]], atol=1e-6)


def test_small_frames_are_enlarged(frames):
    assert preprocess(*frames, 0.04, (20, 24)).shape == (3, 4, 20, 24)
