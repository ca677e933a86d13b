"""Preprocessing of frames to the network input, and decoding of outputs to poses."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from torch.nn import functional

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.models.conventions import OutputConvention, parse_convention
from s2rtools.models.input_contract import InputContract
from s2rtools.models.preprocessing import preprocess, resize


@pytest.fixture
def frames():
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (3, 16, 16, 3), dtype=np.uint8)
    return rgb, rng.integers(0, 256, (3, 16, 16), dtype=np.uint8)


def contract(size, **changes) -> InputContract:
    return InputContract(size=size, **changes)


def test_frames_of_the_input_size_are_only_scaled(frames):
    rgb, depth = frames
    x = preprocess(rgb, depth, 10 / 255, contract((16, 16)))
    assert x.shape == (3, 4, 16, 16)
    assert x.dtype == np.float32
    np.testing.assert_allclose(x[:, :3], np.moveaxis(rgb / 127.5 - 1, -1, 1), atol=3e-7)
    np.testing.assert_allclose(x[:, 3], depth / 127.5 - 1, atol=3e-7)
    assert resize(rgb, (16, 16), "area") is rgb


def test_halving_averages_areas(frames):
    rgb, depth = frames
    small, small_depth = (resize(images, (8, 8), "area") for images in frames)
    means = rgb.astype(float).reshape(3, 8, 2, 8, 2, 3).mean(axis=(2, 4))
    assert small.dtype == np.uint8
    assert np.abs(small - means).max() <= 0.5
    assert np.abs(small_depth - depth.reshape(3, 8, 2, 8, 2).mean(axis=(2, 4))).max() <= 0.5
    np.testing.assert_array_equal(
        preprocess(rgb, depth, 0.01, contract((8, 8))),
        preprocess(small, small_depth, 0.01, contract((8, 8))),
    )


def test_small_frames_are_enlarged(frames):
    assert preprocess(*frames, 0.04, contract((20, 24))).shape == (3, 4, 20, 24)
    areas, lines = (resize(frames[0], (20, 24), how) for how in ("area", "bilinear"))
    np.testing.assert_array_equal(areas, lines)


def test_colours_are_normalised_as_torchvision_does(frames):
    rgb, depth = frames
    mean, std = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
    given = contract((16, 16), channels="rgb", mean=mean, std=std)
    x = preprocess(rgb, depth, 0.01, given)
    expected = (rgb / 255 - np.array(mean)) / np.array(std)
    assert x.shape == (3, 3, 16, 16)
    np.testing.assert_allclose(x, np.moveaxis(expected, -1, 1), atol=2e-6)
    turned = preprocess(rgb, depth, 0.01, replace(given, colour_order="bgr"))
    np.testing.assert_array_equal(turned, x[:, ::-1])


def test_grey_levels_reach_a_network_that_takes_them(frames):
    given = contract((16, 16), channels="rgb", rgb_scale=255.0, mean=(1, 2, 3), std=(1, 1, 1))
    x = preprocess(*frames, 0.01, given)
    np.testing.assert_allclose(x, np.moveaxis(frames[0] - [1.0, 2, 3], -1, 1), atol=1e-4)


PLAIN = {"channels": "depth", "depth_unit": 1.0, "depth_mean": 0.0, "depth_std": 1.0}
RANGE = {**PLAIN, "depth_range": (0.5, 5.0)}


@pytest.mark.parametrize(
    ("raw", "scale", "given", "expected"),
    [
        ([0, 5000, 10_000, 60_000], 0.001, {"channels": "depth"}, [-1, 0, 1, 1]),
        ([0, 700, 3000, 9000], 0.001, {**RANGE, "depth_unit": 0.001}, [500, 700, 3000, 5000]),
        ([0, 20, 100, 700], 0.01, {**RANGE, "missing_depth": 0.0}, [0, 0.5, 1, 5]),
    ],
    ids=["10 m by default", "unit and range", "missing outside of the range"],
)
def test_depth_is_given_in_its_unit_and_range(raw, scale, given, expected):
    depth = np.array(raw, dtype=np.uint16).reshape(1, 2, 2)
    rgb = np.zeros((1, 2, 2, 3), np.uint8)
    x = preprocess(rgb, depth, scale, contract((2, 2), **given), depth > 0)
    np.testing.assert_allclose(x.ravel(), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("missing", "corner"), [(None, 0.75), (7.0, 7.0)])
def test_missing_depth_becomes_the_declared_distance_before_it_is_resized(missing, corner):
    depth = np.full((1, 4, 4), 100, dtype=np.uint8)
    depth[0, 0, 0] = 0
    given = contract((2, 2), **PLAIN, missing_depth=missing)
    x = preprocess(np.zeros((1, 4, 4, 3), np.uint8), depth, 0.01, given, depth > 0)
    np.testing.assert_allclose(x, [[[[corner, 1], [1, 1]]]], rtol=1e-6)


OPENCV = {"nearest": cv2.INTER_NEAREST, "bilinear": cv2.INTER_LINEAR, "bicubic": cv2.INTER_CUBIC}


@pytest.mark.parametrize("name", list(OPENCV))
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_interpolations_are_those_of_opencv(name, dtype):
    images = np.random.default_rng(1).integers(0, 256, (2, 30, 40), dtype=dtype)
    expected = [cv2.resize(image, (18, 14), interpolation=OPENCV[name]) for image in images]
    np.testing.assert_array_equal(resize(images, (14, 18), name), expected)


def test_antialiased_interpolation_is_that_of_torchvision():
    rgb = np.random.default_rng(2).integers(0, 256, (2, 30, 40, 3), dtype=np.uint8)
    x = torch.from_numpy(rgb).permute(0, 3, 1, 2).float()
    expected = functional.interpolate(x, (14, 18), mode="bilinear", antialias=True).round()
    small = resize(rgb, (14, 18), "bilinear-antialias")
    assert small.dtype == np.uint8
    np.testing.assert_array_equal(np.moveaxis(small, -1, 1), expected.numpy())


HEADINGS = torch.linspace(-3.1, 3.1, 9, dtype=torch.float64)


def raw_output(convention: OutputConvention, heading: torch.Tensor) -> torch.Tensor:
    """The output of an ideal network of this convention at (1, 2) with these map headings."""
    frame_heading = heading if convention.frame == "map" else -math.pi / 2 - heading
    position = [torch.full_like(frame_heading, 1.0), torch.full_like(frame_heading, 2.0)]
    if convention.heading == "cos_sin":
        return torch.stack([*position, 3 * frame_heading.cos(), 3 * frame_heading.sin()], dim=1)
    unit = 180 / math.pi if convention.heading == "degrees" else 1.0
    return torch.stack([*position, frame_heading * unit + 2 * math.pi * unit], dim=1)


@pytest.mark.parametrize("heading", ["degrees", "radians", "cos_sin"])
@pytest.mark.parametrize("frame", ["map", "habitat"])
def test_every_convention_decodes_to_map_radians(heading, frame):
    convention = OutputConvention(heading, frame)
    raw = raw_output(convention, HEADINGS)
    pose = convention.decode(raw)
    assert raw.shape[1] == convention.width
    torch.testing.assert_close(pose[:, :2], raw[:, :2])
    np.testing.assert_allclose(angles.distance(pose[:, 2].numpy(), HEADINGS.numpy()), 0, atol=1e-9)
    parts = convention.components(raw)
    torch.testing.assert_close(torch.atan2(parts[:, 3], parts[:, 2]), HEADINGS)


def test_conventions_are_parsed_from_text():
    convention = OutputConvention("degrees", "habitat")
    assert parse_convention(convention.to_json()) == convention
    assert parse_convention("degrees, habitat") == convention
    assert parse_convention("cos_sin") == OutputConvention("cos_sin", "map")


@pytest.mark.parametrize("text", ["turns", "degrees,moon", "{bad", '{"heading": 3}', ""])
def test_invalid_text_is_rejected_with_the_valid_forms(text):
    with pytest.raises(RequestError, match="output convention"):
        parse_convention(text)
