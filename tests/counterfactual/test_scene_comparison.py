"""Changed content is cut into segments; views of other rigs are synthesised."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.records import Domain, Intrinsics
from s2rtools.counterfactual.depth_tolerance import DepthTolerance
from s2rtools.counterfactual.factor_composites import mix_sources
from s2rtools.counterfactual.scene_comparison import (
    MAX_SEGMENTS,
    ImageArrays,
    RigPair,
    cut_segments,
)
from s2rtools.counterfactual.view_synthesis import DepthInRgbView, ViewSynthesis
from s2rtools.synthetic_world.world import standard_camera
from tests.counterfactual.views import FRAME, LOWERED, SIZE, metres, rendered, rig

CAMERA = standard_camera(SIZE)
TOLERANCE = DepthTolerance(0.03, 0.005, 0.0, 8.0)
EQUAL = RigPair(rig(CAMERA), rig(CAMERA), FRAME, TOLERANCE)
MOVED = RigPair(rig(CAMERA), rig(LOWERED), FRAME, TOLERANCE)
PATCH = np.s_[24:40, 10:30]


def with_box(image: ImageArrays) -> ImageArrays:
    """The image with a near, bright box in front of the scene."""
    rgb, raw, valid = (each.copy() for each in image)
    rgb[PATCH], raw[PATCH], valid[PATCH] = (240, 20, 200), 600, True
    return rgb, raw, valid


def dimmed(image: ImageArrays) -> ImageArrays:
    return (image[0] * 0.75 + 8).astype(np.uint8), image[1], image[2]


def test_equal_scenes_have_no_segments():
    for image in rendered("sim", CAMERA)[:6]:
        scenes = EQUAL.in_real_view(image, dimmed(image))
        assert scenes.count == 0
        assert np.allclose(scenes.depth, metres(image), atol=1e-6)


def test_an_added_object_is_one_segment_and_gone_in_the_counterfactual():
    image = rendered("sim", CAMERA)[2]
    scenes = EQUAL.in_real_view(image, with_box(dimmed(image)))
    inside = scenes.segments[PATCH]
    assert (inside > 0).mean() > 0.95
    assert np.bincount(inside[inside > 0]).argmax() == 1
    outside = scenes.segments.copy()
    outside[22:42, 8:32] = 0
    assert (outside > 0).mean() < 0.02
    expected = dimmed(image)[0].astype(float)
    assert np.abs(scenes.rgb - expected)[PATCH].mean() < 8
    far = np.where(metres(image) <= TOLERANCE.far, metres(image), 0)
    assert (np.abs(scenes.depth - far)[PATCH] > 1e-3).mean() < 0.03


@pytest.mark.parametrize("view", ["real", "sim"])
def test_changed_objects_of_a_world_are_found_by_other_rigs(view):
    sims, reals = rendered("sim", CAMERA), rendered("real", LOWERED)
    unchanged = rendered("sim", LOWERED)
    hits, alarms, changed_pixels = 0, 0, 0
    for sim, real, same in zip(sims, reals, unchanged, strict=True):
        scenes = getattr(MOVED, f"in_{view}_view")(sim, real)
        if view == "real":
            changed = (np.abs(real[0].astype(int) - same[0]).max(axis=2) > 40) & scenes.view.seen
            changed_pixels += changed.sum()
            hits += ((scenes.segments > 0) & changed).sum()
        alarms += getattr(MOVED, f"in_{view}_view")(sim, same).segments.astype(bool).mean()
    assert alarms / len(sims) < 0.15
    if view == "real":
        assert changed_pixels > 200
        assert hits / changed_pixels > 0.6


def test_composites_begin_with_the_sim_and_end_with_the_real_image():
    image = rendered("sim", CAMERA)[2]
    real = with_box(dimmed(image))
    contents = EQUAL.in_sim_view(image, real).contents("sim")
    colours = np.moveaxis(contents.colours, 3, 1)
    sources = np.concatenate([colours, contents.mixed_depths[:, None]], axis=1)
    mixed = mix_sources(sources, contents.changed, 3)
    rgb, depth = np.moveaxis(mixed[:, :3], 1, 3), mixed[:, 3]
    assert rgb.shape == (16, *FRAME, 3)
    assert np.array_equal(rgb[0], image[0])
    assert np.abs(rgb[-1] - real[0])[2:-2, 2:-2].mean() < 0.5
    assert np.allclose(depth[0], metres(image), atol=1e-6)
    assert np.abs(depth[-1] - metres(real))[2:-2, 2:-2].max() < 1e-3
    lit = rgb[1]
    assert np.abs(lit - dimmed(image)[0])[2:-2, 2:-2].mean() < 4


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.6))
def test_segments_are_numbered_without_gaps(seed, share):
    rng = np.random.default_rng(seed)
    blocks = rng.random((8, 8)) < share
    change = np.kron(blocks, np.ones((8, 8))).astype(np.float32) * 2
    segments = cut_segments(change)
    numbers = np.unique(segments)
    assert np.array_equal(numbers, np.arange(len(numbers)) + numbers[0])
    assert segments.max() <= MAX_SEGMENTS
    assert (segments > 0).any() == blocks.any()


@pytest.mark.parametrize("height", [-0.08, 0.0])
@pytest.mark.parametrize("zoom", [0.85, 1.05, 1.2])
def test_another_camera_alone_changes_no_depth(height, zoom):
    """Composites that differ in the factor depth alone are equal, also beyond the other view."""
    camera = CAMERA.moved(height=height, zoom=zoom)
    rigs = RigPair(rig(CAMERA), rig(camera), FRAME, TOLERANCE)
    changes = []
    for sim, real in zip(rendered("sim", CAMERA)[:6], rendered("sim", camera)[:6], strict=True):
        for side, scenes in (
            ("sim", rigs.in_sim_view(sim, real)),
            ("real", rigs.in_real_view(sim, real)),
        ):
            contents = scenes.contents(side)
            clean, noisy = contents.mixed_depths[:2]
            changes.append((noisy > 0).mean() - (clean > 0).mean())
            own, value = (sim, clean) if side == "sim" else (real, contents.mixed_depths[3])
            assert np.allclose(value, metres(own), atol=1e-6)
    assert np.abs(np.mean(changes)) < 0.02


def test_depth_beyond_the_rgb_view_stays_that_of_the_view():
    wide = replace(rig(CAMERA), depth=replace(CAMERA.lens, fx=CAMERA.lens.fx * 0.6))
    registration = DepthInRgbView(wide, FRAME)
    own = np.full(FRAME, 3.0, np.float32)
    moved = registration.to_depth_camera(np.full(FRAME, 2.0, np.float32), own)
    assert (moved == 3.0).mean() == pytest.approx(0.4, abs=0.05)
    assert (moved > 0).all()


def test_the_view_of_another_rig_equals_its_rendering():
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


def shifted(columns: float) -> Domain:
    """A rig whose depth camera is turned so that its image lies `columns` to the left."""
    lens = Intrinsics(60.0, 60.0, SIZE / 2, SIZE / 2, 0.0)
    depth = replace(lens, cx=lens.cx - columns)
    return Domain("rig", "real", lens, depth, 0.6, 0.0, 0.001, 1, 10_000)


def test_depth_is_registered_to_rgb_and_back():
    registration = DepthInRgbView(shifted(5), FRAME)
    assert not registration.is_identity
    raw = np.tile(np.arange(SIZE), (SIZE, 1)) * 10 + 1000
    found = registration.metres(raw, np.ones(FRAME, bool))
    assert np.allclose(found[:, 5:], raw[:, : SIZE - 5] * 0.001)
    assert not found[:, :5].any()
    back = registration.to_depth_pixels(found)
    assert np.allclose(back[:, : SIZE - 5], raw[:, : SIZE - 5] * 0.001)


@pytest.mark.parametrize("size", [SIZE, SIZE // 2])
def test_values_over_depth_pixels_keep_their_sum_in_rgb_pixels(size):
    registration = DepthInRgbView(shifted(8), FRAME)
    values = np.zeros((2, size, size), np.float32)
    values[:, :, : size // 2] = np.random.default_rng(1).random((2, size, size // 2))
    moved = registration.moved_to_rgb(values)
    assert moved.shape == values.shape
    assert np.allclose(moved.sum(axis=(1, 2)), values.sum(axis=(1, 2)), rtol=1e-5)
    assert np.allclose(moved[:, :, size // 8 :], values[:, :, : size - size // 8])
