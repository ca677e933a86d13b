"""The mismatch of image pairs: zero for equal images, and each kind of difference apart."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtools.suggestions import image_mismatch

N, SIZE = 3, 64
COLUMNS = {"colour": slice(0, 768), "depth": slice(768, 1024), "missing": slice(1024, 1040),
           "noise": slice(1040, 1043)}  # fmt: skip


@pytest.fixture
def images():
    rng = np.random.default_rng(2)
    u, v = np.meshgrid(np.linspace(0, 5, SIZE), np.linspace(0, 3, SIZE))
    phase = rng.random((N, 1, 1)) * 6
    rgb = 120 + 60 * np.sin(u + phase)[..., None] * np.array([1.0, 0.8, 0.6])
    depth = 2.5 + 1.5 * np.cos(v + phase)
    return rgb.astype(np.uint8), depth.astype(np.float32), np.ones((N, SIZE, SIZE), dtype=bool)


def changed(images, other):
    difference = image_mismatch.residuals(other, images)
    return {name: float(np.abs(difference[:, part]).max()) for name, part in COLUMNS.items()}


def test_equal_images_have_no_mismatch(images):
    difference = image_mismatch.residuals(images, images)
    assert difference.shape == (N, image_mismatch.weights().size)
    np.testing.assert_array_equal(difference, 0)
    np.testing.assert_array_equal(image_mismatch.cost(difference, image_mismatch.weights()), 0)


def test_brighter_images_differ_in_colour_alone(images):
    rgb, depth, valid = images
    found = changed(images, (np.clip(rgb * 1.2, 0, 255).astype(np.uint8), depth, valid))
    assert found["colour"] > 1
    assert (found["depth"], found["missing"], found["noise"]) == (0, 0, 0)


def test_longer_depth_differs_by_its_logarithm(images):
    rgb, depth, valid = images
    difference = image_mismatch.residuals((rgb, depth * 1.1, valid), images)
    np.testing.assert_allclose(difference[:, COLUMNS["depth"]], np.log(1.1) / 0.05, rtol=1e-4)
    assert np.abs(difference[:, COLUMNS["colour"]]).max() == 0


def test_noise_of_depth_is_seen_whatever_its_draw(images):
    rgb, depth, valid = images
    rng = np.random.default_rng(3)
    first, second = (
        (rgb, (depth * (1 + 0.03 * rng.standard_normal(depth.shape))).astype(np.float32), valid)
        for _ in range(2)
    )
    assert changed(images, first)["noise"] > 3
    assert changed(first, second)["noise"] < 0.5


def test_missing_depth_counts_as_missing_and_not_as_wrong(images):
    rgb, depth, valid = images
    holes = valid.copy()
    holes[:, :20] = False
    found = changed(images, (rgb, np.where(holes, depth, 0), holes))
    assert found["missing"] > 3
    assert found["depth"] == 0


def test_shares_of_valid_pixels_are_by_cell():
    valid = np.ones((1, SIZE, SIZE), dtype=bool)
    valid[0, : SIZE // 4] = False
    shares = image_mismatch._valid_shares(valid).reshape(4, 4)
    np.testing.assert_array_equal(shares[0], 0)
    np.testing.assert_array_equal(shares[1:], 1)


def test_models_without_a_channel_compare_the_others_only(images):
    rgb, depth, valid = images
    other = rgb, depth * 2, valid
    assert image_mismatch.residuals(other, images, "rgb").shape == (N, 768)
    np.testing.assert_array_equal(image_mismatch.residuals(other, images, "rgb"), 0)
    assert image_mismatch.residuals(other, images, "depth").shape == (N, 275)
    for channels in ("rgb", "depth", "rgbd"):
        columns = image_mismatch.residuals(other, images, channels).shape[1]
        assert image_mismatch.weights(channels).size == columns
