"""Back-projection compared with an explicit loop and with known walls."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.geometry import angles
from s2rstore.geometry.curvature import curvature
from s2rstore.geometry.floor_grid import SAMPLES, Projector
from s2rstore.geometry.map_grid import AGGREGATES, MapGrid
from s2rstore.geometry.rooms import room_codes
from s2rstore.records import Bounds, Domain, Intrinsics, Room

FRAME = (256, 256)
BOUNDS = Bounds(-6.0, -5.0, 10.0, 7.0)


def domain(hfov: float = 80.0, pitch: float = 0.0, rgb_pitch: float = -0.1, **changes) -> Domain:
    f = 128 / math.tan(math.radians(hfov) / 2)
    base = Domain(
        "d", "sim", Intrinsics(240.7, 240.7, 128, 128, rgb_pitch),
        Intrinsics(f, f, 128, 128, pitch), 0.6, -0.047, 10 / 255, 6, 249,
    )  # fmt: skip
    return replace(base, **changes)


def project_pixel_by_pixel(
    heat, depth, record: Domain, pose, y_down: bool, ray: str, grid: MapGrid
):
    """One pixel at a time, from the textbook formulas."""
    cells, values = [], []
    for row in range(SAMPLES):
        for col in range(SAMPLES):
            j, i = int((col + 0.5) * FRAME[1] / SAMPLES), int((row + 0.5) * FRAME[0] / SAMPLES)
            raw = int(depth[i, j])
            u, v = j + 0.5, i + 0.5
            if not record.depth_raw_min <= raw <= record.depth_raw_max:
                continue
            d = raw * record.depth_scale
            right = d * (u - record.depth.cx) / record.depth.fx
            up = -d * (v - record.depth.cy) / record.depth.fy
            p = record.depth.pitch
            ahead, height = (
                d * math.cos(p) - up * math.sin(p), d * math.sin(p) + up * math.cos(p)
            )  # fmt: skip
            if not 0.1 <= record.camera_height + height <= 2.0:
                continue
            if ray == "rgb":
                q = record.rgb.pitch
                z = ahead * math.cos(q) + height * math.sin(q)
                y = height * math.cos(q) - ahead * math.sin(q)
                if z <= 0:
                    continue
                su = record.rgb.cx + record.rgb.fx * right / z
                sv = record.rgb.cy - record.rgb.fy * y / z
                if not (0 <= su < FRAME[1] and 0 <= sv < FRAME[0]):
                    continue
                share = sv / FRAME[0], su / FRAME[1]
            else:
                share = v / FRAME[0], u / FRAME[1]
            value = heat[int(share[0] * heat.shape[0]), int(share[1] * heat.shape[1])]
            ahead += record.forward_offset
            sign = 1 if y_down else -1
            x = pose[0] + ahead * math.cos(pose[2]) - sign * right * math.sin(pose[2])
            y = pose[1] + ahead * math.sin(pose[2]) + sign * right * math.cos(pose[2])
            c = math.floor((x - BOUNDS.x0) / BOUNDS.width * grid.cols)
            r = math.floor((y - BOUNDS.y0) / BOUNDS.height * grid.rows)
            if 0 <= c < grid.cols and 0 <= r < grid.rows and np.isfinite(value):
                cells.append(r * grid.cols + c)
                values.append(float(value))
    return cells, values


@pytest.mark.parametrize("ray", ["rgb", "depth"])
@pytest.mark.parametrize("y_down", [True, False])
@pytest.mark.parametrize("pitch", [0.0, 0.05])
def test_projection_equals_the_explicit_loop(ray, y_down, pitch):
    rng = np.random.default_rng(1)
    depth = rng.integers(0, 256, FRAME).astype(np.uint8)
    heat = rng.normal(0, 1, (16, 16)).astype(np.float32)
    heat[3, 4] = np.nan
    pose = np.array([2.0, 1.0, 0.7])
    grid = MapGrid(BOUNDS)
    record = domain(pitch=pitch)
    projector = Projector(record, FRAME, y_down)
    cells, values = projector.project(heat[None], depth[None], pose[None], ray, grid)
    expected = project_pixel_by_pixel(heat, depth, record, pose, y_down, ray, grid)
    assert sorted(zip(cells.tolist(), values.tolist(), strict=True)) == pytest.approx(
        sorted(zip(*expected, strict=True))
    )


@given(
    x=st.floats(-2, 6), y=st.floats(-2, 4), heading=st.floats(-3.1, 3.1),
    raw=st.integers(20, 80), hfov=st.floats(50, 90),
)  # fmt: skip
def test_a_wall_ahead_is_a_perpendicular_line(x, y, heading, raw, hfov):
    record = domain(hfov, forward_offset=0.0)
    projector = Projector(record, FRAME, True, (-9, 9))
    depth = np.full((1, *FRAME), raw, np.uint8)
    px, py, _, valid = projector.points(depth, np.array([[x, y, heading]]))
    ahead = (px - x) * np.cos(heading) + (py - y) * np.sin(heading)
    right = -(px - x) * np.sin(heading) + (py - y) * np.cos(heading)
    assert np.allclose(ahead[valid], raw * 10 / 255)
    widest = raw * 10 / 255 * math.tan(math.radians(hfov) / 2)
    assert np.isclose(right[valid].max(), widest, rtol=0.02)
    assert right[0, 0, -1] > 0 > right[0, 0, 0]


@pytest.mark.parametrize(("height", "is_visible"), [(0.6, True), (0.05, False), (2.5, False)])
def test_a_level_ray_has_the_height_of_the_camera(height, is_visible):
    record = domain(camera_height=height)
    level = replace(record, depth=replace(record.depth, cy=127.5))
    depth = np.full((1, *FRAME), 100, np.uint8)
    *_, valid = Projector(level, FRAME, True).points(depth, np.zeros((1, 3)))
    assert (valid[0, 63] == is_visible).all()


def test_a_batch_equals_its_single_images():
    rng = np.random.default_rng(7)
    depth = rng.integers(0, 65536, (3, 60, 100)).astype(np.uint16)
    heat = rng.normal(0, 1, (3, 6, 6)).astype(np.float32)
    poses = np.array([[0.0, 0, 0], [1, 1, 1], [2, -1, -2]])
    record = domain(
        depth_scale=1e-4, depth_raw_max=60000,
        rgb=Intrinsics(60, 60, 50, 30), depth=Intrinsics(40, 40, 50, 30),
    )  # fmt: skip
    projector, grid = Projector(record, (60, 100), False), MapGrid(BOUNDS)
    batched = projector.project(heat, depth, poses, "rgb", grid)
    single = [
        projector.project(heat[i : i + 1], depth[i : i + 1], poses[i : i + 1], "rgb", grid)
        for i in range(3)
    ]
    for values_found, parts in zip(batched, zip(*single, strict=True), strict=True):
        assert values_found.size > 0
        assert (values_found == np.concatenate(parts)).all()
    empty = projector.project(heat[:0], depth[:0], poses[:0], "rgb", grid)
    assert [part.size for part in empty] == [0, 0]


def test_points_outside_the_bounds_have_no_cell():
    grid = MapGrid(BOUNDS, 16)
    x = np.array([-6.0, 9.999, 10.0, -6.001, np.nan, np.inf, 0.0])
    y = np.array([-5.0, 6.999, 0.0, 0.0, 0.0, 0.0, np.nan])
    inside, cells = grid.locate(x, y)
    assert np.where(inside, cells, -1).tolist() == [
        0,
        grid.rows * grid.cols - 1,
        -1,
        -1,
        -1,
        -1,
        -1,
    ]


def test_grid_aggregates_equal_explicit_aggregation():
    rng = np.random.default_rng(5)
    grid = MapGrid(BOUNDS, 20)
    values_of_cell: dict[int, list[float]] = {}
    for _ in range(3):
        cells = rng.integers(0, grid.rows * grid.cols, 100)
        values = rng.normal(0, 1, 100)
        grid.add(cells, values)
        for cell, value in zip(cells.tolist(), values.tolist(), strict=True):
            values_of_cell.setdefault(cell, []).append(value)
    planes = dict(zip(AGGREGATES, grid.aggregates(), strict=True))
    for cell in range(grid.rows * grid.cols):
        row, col = divmod(cell, grid.cols)
        cell_values = values_of_cell.get(cell)
        assert planes["count"][row, col] == len(cell_values or ())
        if cell_values is None:
            assert np.isnan([planes[name][row, col] for name in ("mean", "max", "sum")]).all()
        else:
            assert planes["mean"][row, col] == pytest.approx(np.mean(cell_values), rel=1e-5)
            assert planes["max"][row, col] == pytest.approx(max(cell_values), rel=1e-5)
            assert planes["sum"][row, col] == pytest.approx(sum(cell_values), rel=1e-4, abs=1e-6)


def test_the_first_of_overlapping_rooms_is_used_and_edges_are_inside():
    rooms = [Room("b", 1, 0, 0, 4, 4), Room("a", 0, 2, 2, 6, 6), Room("a", 2, 8, 8, 9, 9)]
    x = np.array([1.0, 2.0, 3.0, 6.0, 7.0, 9.0, np.nan])
    assert room_codes(x, x, rooms, ["a", "b"]).tolist() == [1, 0, 0, 0, -1, 0, -1]


def test_curvature_is_the_heading_change_over_seven_instances():
    heading = np.radians([170.0, 175, 180, -175, -170, -165, -160, -160])
    expected = [15, 20, 25, 30, 25, 20, 15, 10]
    assert np.allclose(curvature(angles.wrap(heading)), expected)
    assert curvature(np.array([])).size == 0
