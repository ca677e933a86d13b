"""Image harmonisation: equal rigs change nothing, and the offset of a moved rig is estimated."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.geometry.reprojection import NearerSurface, Reprojection
from s2rstore.records import Domain, Intrinsics
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.precompute.domain_calibration import calibrate
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from s2rtools.synthetic_world.world import to_raw_depth

FRAME = (96, 96)
LENS = Intrinsics(66.0, 66.0, 48.0, 48.0, 0.0)
RAW = st.just(0) | st.integers(60, 12_000)
RIG = Domain("sim", "sim", LENS, LENS, 0.62, 0.0, 0.001, 1, 10_000)


@pytest.fixture(scope="module")
def data() -> WorldData:
    return WorldData(WorldRecipe(seed=3, count=12, frame=96, factors={"camera": 1.0}))


def images(data: WorldData, side: str, rows: slice = slice(None)) -> list:
    poses = data.poses["traj1"][rows]
    views = data.views(side, poses, np.arange(len(poses)))
    depth = to_raw_depth(views.depth)
    return [(rgb, raw, raw > 0) for rgb, raw in zip(views.rgb, depth, strict=True)]


def rig(data: WorldData, name: str) -> Domain:
    from s2rtools.synthetic_world.world import standard_camera

    camera = standard_camera(96)
    return Domain(name, name, camera.lens, camera.lens, camera.height, 0.0, 0.001, 1, 10_000)


def test_equal_rigs_and_images_are_unchanged(data):
    sim_image = images(data, "sim")[0]
    sim, real = rig(data, "sim"), rig(data, "real")
    harmonised = ImageAlignment(sim, real, FRAME, RigOffset()).sim_view.harmonise(
        sim_image, sim_image
    )
    visible = harmonised.visible
    assert visible.mean() > 0.9
    assert np.abs(harmonised.real - harmonised.sim)[visible].max() < 1.0
    assert np.abs(harmonised.real_depth - harmonised.sim_depth).max() < 1e-3


def test_a_colour_cast_is_removed(data):
    rgb, depth, valid = images(data, "sim")[1]
    cast = np.clip(rgb * np.array([0.9, 0.7, 0.5]) + 20, 0, 255).astype(np.uint8)
    sim, real = rig(data, "sim"), rig(data, "real")
    harmonised = ImageAlignment(sim, real, FRAME, RigOffset()).sim_view.harmonise(
        (rgb, depth, valid), (cast, depth, valid)
    )
    before = np.abs(cast.astype(float) - rgb).mean()
    assert np.abs(harmonised.real - harmonised.sim).mean() < 0.15 * before


def test_the_true_offset_is_estimated_and_reduces_the_misfit(data):
    pairs = list(zip(images(data, "sim"), images(data, "real"), strict=True))
    sim, real = rig(data, "sim"), rig(data, "real")
    offset = calibrate(sim, real, FRAME, pairs)
    assert offset.height == pytest.approx(-0.09, abs=0.03)
    assert offset.zoom == pytest.approx(1.06, abs=0.02)

    def misfit(correction: RigOffset) -> float:
        view = ImageAlignment(sim, real, FRAME, correction).sim_view
        harmonised = [view.harmonise(*pair) for pair in pairs]
        return float(np.mean([np.abs(m.real - m.sim)[m.visible].mean() for m in harmonised]))

    assert misfit(offset) < 0.75 * misfit(RigOffset())


def test_warping_to_the_other_view_and_back_restores_the_map(data):
    """The map lies on surfaces."""
    sim, real = rig(data, "sim"), rig(data, "real")
    aligned = ImageAlignment(sim, real, FRAME, RigOffset(-0.09, 1.06))
    (_, depth, valid), (_, real_depth, real_valid) = images(data, "sim")[2], images(data, "real")[2]
    columns = np.broadcast_to(np.arange(96, dtype=np.float32), FRAME).copy()
    warped = aligned.sim_view.warp_from_other(columns, depth, valid)
    restored = aligned.real_view.warp_from_other(
        np.nan_to_num(warped, nan=-500.0), real_depth, real_valid
    )
    is_known = np.isfinite(restored) & (restored > 0)
    assert is_known.mean() > 0.5
    assert np.median(np.abs(restored - columns)[is_known]) < 0.6


def test_reprojection_keeps_the_point_in_space():
    other = replace(RIG, camera_height=0.4, forward_offset=0.1)
    metres = np.full(FRAME, 2.5)
    u, v, depth, inside = Reprojection(RIG, LENS, other, FRAME).targets(metres, LENS)
    row, col = 40, 60
    assert inside[row, col]
    x = (u[row, col] - LENS.cx) / LENS.fx * depth[row, col]
    y = -(v[row, col] - LENS.cy) / LENS.fy * depth[row, col]
    point_in_other = np.array([x, y + 0.4, depth[row, col] + 0.1])
    point = np.array([(col + 0.5 - 48) / 66 * 2.5, -(row + 0.5 - 48) / 66 * 2.5 + 0.62, 2.5])
    assert np.allclose(point_in_other, point)


@given(arrays.arrays(np.uint16, (2, 12, 12), elements=RAW),
       arrays.arrays(np.uint16, (2, 12, 12), elements=RAW))  # fmt: skip
def test_the_nearer_surface_is_the_minimum_of_both_depths(first, second):
    lens = Intrinsics(8.0, 8.0, 6.0, 6.0, 0.0)
    a = replace(RIG, rgb=lens, depth=lens)
    b = replace(a, domain="real", kind="real")
    nearer = NearerSurface(a, b, (12, 12))(first, second)
    assert (nearer <= first).all()
    known = (first >= 1) & (first <= 10_000)
    both = known & (second >= 1) & (second <= 10_000)
    assert np.array_equal(nearer[~both], first[~both])
    assert np.array_equal(nearer[both], np.minimum(first, second)[both])
