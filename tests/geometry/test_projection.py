"""Back-projection against a plain loop, against known walls, and on real data."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore import angles
from s2rstore.geometry.grid import AGGREGATES, SAMPLES, MapGrid, Projector
from s2rstore.geometry.rooms import room_codes
from s2rstore.geometry.trajectory import curvature
from s2rstore.records import Bounds, Domain, Intrinsics, Room

FRAME = (256, 256)
BOUNDS = Bounds(-6.0, -5.0, 10.0, 7.0)


def domain(hfov: float = 80.0, pitch: float = 0.0, rgb_pitch: float = -0.1, **changes) -> Domain:
    f = 128 / math.tan(math.radians(hfov) / 2)
    made = Domain(
        "d", "sim", Intrinsics(240.7, 240.7, 128, 128, rgb_pitch),
        Intrinsics(f, f, 128, 128, pitch), 0.6, -0.047, 10 / 255, 6, 249,
    )  # fmt: skip
    return replace(made, **changes)


def plain_loop(heat, depth, record: Domain, pose, y_down: bool, ray: str, grid: MapGrid):
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
def test_equals_the_plain_loop(ray: str, y_down: bool, pitch: float) -> None:
    rng = np.random.default_rng(1)
    depth = rng.integers(0, 256, FRAME).astype(np.uint8)
    heat = rng.normal(0, 1, (16, 16)).astype(np.float32)
    heat[3, 4] = np.nan
    pose = np.array([2.0, 1.0, 0.7])
    grid = MapGrid(BOUNDS)
    record = domain(pitch=pitch)
    projector = Projector(record, FRAME, y_down)
    cells, values = projector.project(heat[None], depth[None], pose[None], ray, grid)
    wanted = plain_loop(heat, depth, record, pose, y_down, ray, grid)
    assert sorted(zip(cells.tolist(), values.tolist(), strict=True)) == pytest.approx(
        sorted(zip(*wanted, strict=True))
    )


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-2, 6), y=st.floats(-2, 4), heading=st.floats(-3.1, 3.1),
    raw=st.integers(20, 80), hfov=st.floats(50, 90),
)  # fmt: skip
def test_a_wall_straight_ahead_lies_on_a_line_across(
    x: float, y: float, heading: float, raw: int, hfov: float
) -> None:
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


def test_grid_aggregates_are_those_of_a_dictionary() -> None:
    rng = np.random.default_rng(5)
    grid = MapGrid(BOUNDS, 20)
    seen: dict[int, list[float]] = {}
    for _ in range(3):
        cells = rng.integers(0, grid.rows * grid.cols, 100)
        values = rng.normal(0, 1, 100)
        grid.add(cells, values)
        for cell, value in zip(cells.tolist(), values.tolist(), strict=True):
            seen.setdefault(cell, []).append(value)
    planes = dict(zip(AGGREGATES, grid.aggregates(), strict=True))
    for cell in range(grid.rows * grid.cols):
        row, col = divmod(cell, grid.cols)
        got = seen.get(cell)
        assert planes["count"][row, col] == len(got or ())
        if got is None:
            assert np.isnan([planes[name][row, col] for name in ("mean", "max", "sum")]).all()
        else:
            assert planes["mean"][row, col] == pytest.approx(np.mean(got), rel=1e-5)
            assert planes["max"][row, col] == pytest.approx(max(got), rel=1e-5)
            assert planes["sum"][row, col] == pytest.approx(sum(got), rel=1e-4, abs=1e-6)


def test_the_first_of_overlapping_rooms_wins_and_edges_belong() -> None:
    rooms = [Room("b", 1, 0, 0, 4, 4), Room("a", 0, 2, 2, 6, 6), Room("a", 2, 8, 8, 9, 9)]
    x = np.array([1.0, 2.0, 3.0, 6.0, 7.0, 9.0, np.nan])
    assert room_codes(x, x, rooms, ["a", "b"]).tolist() == [1, 0, 0, 0, -1, 0, -1]


def test_curvature_is_the_heading_change_over_seven_instances() -> None:
    heading = np.radians([170.0, 175, 180, -175, -170, -165, -160, -160])
    wanted = [15, 20, 25, 30, 25, 20, 15, 10]
    assert np.allclose(curvature(angles.wrap(heading)), wanted)
    assert curvature(np.array([])).size == 0


# --- the real data ---------------------------------------------------------------------------


def _sim_edit(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    depths, poses = [], []
    with (folder / "traj1" / "sim" / "match.csv").open() as file:
        names = [row["SIM_RGB"] for row in csv.DictReader(file)]
    for name in names[::2]:
        numbers = re.match(r"x(.*?)_y(.*?)_z(.*?)_r(.*?)_rgb", name)
        assert numbers
        x, _, z, r = map(float, numbers.groups())
        poses.append([x, z, float(angles.from_habitat(math.radians(r)))])
        file_name = name.replace("_rgb", "_depth")
        picture = cv2.imread(str(folder / "traj1" / "sim_edit" / file_name), cv2.IMREAD_GRAYSCALE)
        depths.append(cv2.resize(picture, FRAME, interpolation=cv2.INTER_NEAREST_EXACT))
    return np.stack(depths), np.array(poses)


def _entropy(depth: np.ndarray, poses: np.ndarray, hfov: float, y_down: bool = True) -> float:
    """Nats of the 5 cm top-down histogram of points 0.3 .. 1.5 m above the floor."""
    x, y, _, valid = Projector(domain(hfov), FRAME, y_down, (0.3, 1.5)).points(depth, poses)
    cells = np.floor(x[valid] / 0.05).astype(int) * 100_000 + np.floor(y[valid] / 0.05).astype(int)
    share = np.unique(cells, return_counts=True)[1] / cells.size
    return float(-(share * np.log(share)).sum())


@pytest.mark.real
def test_declared_calibration_gives_the_sharpest_floor(real_data: Path) -> None:
    depth, poses = _sim_edit(real_data)
    declared = _entropy(depth, poses, 80)
    negated = poses * [1, 1, -1]
    assert _entropy(depth, poses, 75) - declared >= 0.2
    assert _entropy(depth, poses, 85) - declared >= 0.2
    assert _entropy(depth, poses, 80, y_down=False) - declared >= 1
    assert _entropy(depth, negated, 80) - declared >= 1
