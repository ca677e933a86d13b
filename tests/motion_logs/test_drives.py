"""Folders of drives, and drives from a store's own odometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from bench.support import robot
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.geometry import angles
from s2rstore.index.transaction import edit
from s2rtools.datasets import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.gap.axis_result import Evidence, GapSettings
from s2rtools.gap.dynamics import options
from s2rtools.motion_logs import csv_reader, read_drives
from s2rtools.motion_logs.rigid_alignment import RigidTransform, fit
from s2rtools.motion_logs.store_odometry import odometry


def put(folder: Path, seed: int, untuned: bool = True) -> Path:
    drive = robot.pair(seed, seconds=5.0, untuned=0.1)
    folder.mkdir(parents=True)
    csv_reader.write(drive.real, folder / "real.csv")
    csv_reader.write(drive.sim, folder / "sim.csv")
    if untuned:
        assert drive.untuned is not None
        assert drive.commands is not None
        csv_reader.write(drive.untuned, folder / "untuned.csv")
        csv_reader.write_commands(drive.commands, folder / "commands.csv")
    return folder


def test_drives_are_read_by_name_with_what_they_have(tmp_path: Path) -> None:
    put(tmp_path / "b", 1, untuned=False)
    put(tmp_path / "a", 2)
    (tmp_path / "a" / "real.png").write_bytes(b"a picture")
    (tmp_path / "notes.txt").write_text("not a drive")
    (tmp_path / ".cache").mkdir()
    first, second = read_drives(tmp_path)
    assert (first.name, second.name) == ("a", "b")
    assert first.untuned is not None
    assert first.commands is not None
    assert first.commands.period == robot.PERIOD
    assert second.untuned is None
    assert second.commands is None


def test_what_is_wrong_with_a_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"nowhere: no such folder"):
        read_drives(tmp_path / "nowhere")
    with pytest.raises(RequestError, match="no drive in it"):
        read_drives(tmp_path)
    folder = put(tmp_path / "a", 1)
    (folder / "sim.tum").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(RequestError, match=r"a: sim\.csv, sim\.tum; only one sim log is allowed"):
        read_drives(tmp_path)
    (folder / "sim.tum").unlink()
    (folder / "sim.csv").unlink()
    with pytest.raises(RequestError, match=r"a: no sim\.\* in it"):
        read_drives(tmp_path)


def store_of(path: Path, columns: dict[str, np.ndarray], names: list[str]) -> Path:
    """An index with nothing but instances."""
    n = len(names)
    path.mkdir()
    with edit(path) as draft:
        draft.insert_row(
            "dataset",
            {"name": "odometry", "hash": "0" * 64, "bounds_x0": 0.0, "bounds_y0": 0.0,
             "bounds_x1": 9.0, "bounds_y1": 9.0, "y_down": True, "floor_plan": None,
             "accuracy_scale": 9.0, "frame_height": 8, "frame_width": 8},
        )  # fmt: skip
        for name in dict.fromkeys(names):
            draft.insert_row("trajectory", {"trajectory": name, "instances": names.count(name)})
        seq = [names[:i].count(name) for i, name in enumerate(names)]
        draft.insert(
            "instance",
            {"iid": np.arange(n, dtype=np.int32), "trajectory": names, "seq": seq,
             "room": [None] * n, "curvature": np.zeros(n), **columns},
        )  # fmt: skip
    return path


@pytest.fixture
def walked(tmp_path: Path) -> Path:
    """Trajectory a has mirrored odometry and times, b has no odometry."""
    drive = robot.pair(4, seconds=8.0, noise=0.0, turn_noise=0.0)
    log = robot.sampled(robot.drive(drive.commands), 5.0) if drive.commands else drive.real
    odom = RigidTransform(angle=1.0, reflected=True, x=3.0, y=-2.0)(log)
    n = log.time.size
    missing = np.full(5, np.nan)
    pairs = {"x": log.x, "y": log.y, "heading": log.heading, "odom_x": odom.x, "odom_y": odom.y,
             "odom_heading": odom.heading, "timestamp": log.time + 100.0}  # fmt: skip
    columns = {
        name: np.append(values, missing if name.startswith(("odom", "time")) else np.zeros(5))
        for name, values in pairs.items()
    }
    return store_of(tmp_path / "s.s2r", columns, ["a"] * n + ["b"] * 5)


def test_mirrored_odometry_comes_onto_the_ground_truth(walked: Path) -> None:
    with s2rstore.open(walked) as store:
        (drive,) = odometry(store)
        assert drive.name == "a"
        assert drive.real.time[0] == 100.0
        assert np.hypot(drive.sim.x - drive.real.x, drive.sim.y - drive.real.y).max() < 1e-9
        assert angles.distance(drive.sim.heading, drive.real.heading).max() < 1e-9
        (own,) = odometry(store, rate=5.0, aligned=False)
        assert np.diff(own.real.time) == pytest.approx(0.2)
        assert np.hypot(own.sim.x - own.real.x, own.sim.y - own.real.y).min() > 0.1
        with pytest.raises(RequestError, match="rate 0"):
            odometry(store, rate=0.0)


def test_a_store_without_times_or_odometry(walked: Path, tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store, pytest.raises(RequestError, match="no trajectory has"):
        odometry(store, rate=1.0)
    with edit(walked) as draft:
        draft.update("instance", {"trajectory": "a"}, {"timestamp": None})
    with s2rstore.open(walked) as store, pytest.raises(RequestError, match="declare the rate"):
        odometry(store)


@pytest.mark.real
def test_the_real_datas_odometry_is_off_by_half_a_metre_in_a_mirrored_frame(
    real_data: Path, tmp_path: Path
) -> None:
    sightings = IMPORTERS["sim2realviz"](real_data, ScanOptions()).trajectories["traj1"]
    truth = np.array([(s.x, s.y, s.heading) for s in sightings]).T
    odom = np.array([s.odometry for s in sightings], dtype=np.float64).T
    names = ("x", "y", "heading", "odom_x", "odom_y", "odom_heading")
    columns = dict(zip(names, (*truth, *odom), strict=True))
    path = store_of(tmp_path / "s.s2r", columns, ["traj1"] * len(sightings))
    with s2rstore.open(path) as store:
        (drive,) = odometry(store, rate=1.0)
        evidence = Evidence(store, "none", np.arange(3), drives=[drive])
        axis = options.axes(["horizons=5,10,20", "noise=0,0"])["dynamics"]
        (told,) = axis.measure(evidence, GapSettings(replicates=100)).details["drives"]
    assert told["ape_rmse_recorded"] == pytest.approx(nearest(odom, truth, reflection=True))
    assert nearest(odom, truth, reflection=False) > 5
    off = np.hypot(drive.sim.x - drive.real.x, drive.sim.y - drive.real.y)
    assert np.sqrt((off**2).mean()) == pytest.approx(0.51, abs=0.005)
    assert np.degrees(angles.distance(drive.sim.heading, drive.real.heading)).mean() < 5
    source, target = (odom[0], odom[1]), (truth[0], truth[1])
    assert fit(source, target, reflection=True).reflected
    off = fit_error(source, target, reflection=True, scale=True)
    assert off == pytest.approx(0.33, abs=0.005)
    assert fit_error(source, target, reflection=False, scale=False) > 5


def nearest(odom: np.ndarray, truth: np.ndarray, reflection: bool) -> float:
    """Root mean square distance after the best rigid motion, by the way of Kabsch."""
    a, b = (p[:2] - p[:2].mean(axis=1, keepdims=True) for p in (odom, truth))
    u, _, v = np.linalg.svd(b @ a.T)
    sign = 1.0 if reflection else np.linalg.det(u @ v)
    turn = u @ np.diag([1.0, sign]) @ v
    return float(np.sqrt(((turn @ a - b) ** 2).sum(axis=0).mean()))


def fit_error(source, target, **allowed: bool) -> float:
    found = fit(source, target, **allowed)
    sign = -1 if found.reflected else 1
    turn = np.array(
        [[np.cos(found.angle), -np.sin(found.angle)], [np.sin(found.angle), np.cos(found.angle)]]
    )
    moved = found.scale * turn @ np.stack([source[0], sign * source[1]])
    moved += np.array([[found.x], [found.y]])
    return float(np.sqrt(((moved - np.stack(target)) ** 2).sum(axis=0).mean()))


def test_poses_that_stand_still_cannot_be_aligned() -> None:
    still = (np.full(9, 2.0), np.full(9, 1.0))
    with pytest.raises(InconclusiveError, match="nothing to align by"):
        fit(still, still)
