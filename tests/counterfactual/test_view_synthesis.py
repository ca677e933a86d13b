"""Synthesised views compared with rendering the scene from the other rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from s2rstore.records import Domain, Intrinsics
from s2rtools.counterfactual.view_synthesis import DepthInRgbView, ViewSynthesis
from s2rtools.synthetic_world.world import standard_camera
from tests.counterfactual.views import FRAME, LOWERED, SIZE, metres, rendered, rig

CAMERA = standard_camera(SIZE)


def test_the_view_of_an_equal_rig_is_the_image() -> None:
    synthesis = ViewSynthesis(rig(CAMERA), rig(CAMERA), FRAME)
    for image in rendered("sim", CAMERA)[:4]:
        made = synthesis(image[0], metres(image))
        inner = np.s_[2:-2, 2:-2]
        assert np.abs(made.rgb - image[0])[inner].mean() < 1.0
        assert np.median(np.abs(made.depth - metres(image))[inner]) < 1e-3
        assert made.seen[inner].mean() > 0.98


def test_the_view_of_another_rig_equals_its_rendering() -> None:
    synthesis = ViewSynthesis(rig(CAMERA), rig(LOWERED), FRAME)
    unmoved, errors, depths = [], [], []
    for image, target in zip(rendered("sim", CAMERA), rendered("sim", LOWERED), strict=True):
        made = synthesis(image[0], metres(image))
        both = made.seen & target[2] & (made.depth > 0)
        assert both.mean() > 0.75
        errors.append(np.abs(made.rgb - target[0])[both].mean())
        unmoved.append(np.abs(image[0].astype(float) - target[0])[both].mean())
        depths.append(np.median(np.abs(made.depth - metres(target))[both] / metres(target)[both]))
    assert np.mean(errors) < 0.5 * np.mean(unmoved)
    assert np.mean(depths) < 0.01


def test_nothing_is_seen_without_depth() -> None:
    synthesis = ViewSynthesis(rig(CAMERA), rig(LOWERED), FRAME)
    made = synthesis(np.full((*FRAME, 3), 7, np.uint8), np.zeros(FRAME, np.float32))
    assert not made.seen.any()
    assert not made.depth.any()


def shifted(columns: float) -> Domain:
    """A rig whose depth camera is turned so that its image lies `columns` to the left."""
    lens = Intrinsics(60.0, 60.0, SIZE / 2, SIZE / 2, 0.0)
    depth = replace(lens, cx=lens.cx - columns)
    return Domain("rig", "real", lens, depth, 0.6, 0.0, 0.001, 1, 10_000)


def test_depth_is_registered_to_rgb_and_back() -> None:
    registration = DepthInRgbView(shifted(5), FRAME)
    assert not registration.is_identity
    raw = np.tile(np.arange(SIZE), (SIZE, 1)) * 10 + 1000
    found = registration.metres(raw, np.ones(FRAME, bool))
    assert np.allclose(found[:, 5:], raw[:, : SIZE - 5] * 0.001)
    assert not found[:, :5].any()
    back = registration.to_depth_pixels(found)
    assert np.allclose(back[:, : SIZE - 5], raw[:, : SIZE - 5] * 0.001)


@pytest.mark.parametrize("size", [SIZE, SIZE // 2])
def test_values_over_depth_pixels_keep_their_sum_in_rgb_pixels(size: int) -> None:
    registration = DepthInRgbView(shifted(8), FRAME)
    values = np.zeros((2, size, size), np.float32)
    values[:, :, : size // 2] = np.random.default_rng(1).random((2, size, size // 2))
    moved = registration.moved_to_rgb(values)
    assert moved.shape == values.shape
    assert np.allclose(moved.sum(axis=(1, 2)), values.sum(axis=(1, 2)), rtol=1e-5)
    assert np.allclose(moved[:, :, size // 8 :], values[:, :, : size - size // 8])
