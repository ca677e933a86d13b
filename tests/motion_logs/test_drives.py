"""Folders of drives, and drives from the odometry of a store."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from bench.support import robot
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.geometry import angles
from s2rstore.index.transaction import edit
from s2rtools.motion_logs import csv_reader, read_drives
from s2rtools.motion_logs.motion_log import RigidTransform
from s2rtools.motion_logs.rigid_alignment import fit
from s2rtools.motion_logs.store_odometry import odometry


def write_drive(folder: Path, seed: int, untuned: bool = True) -> Path:
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


def test_drives_are_read_in_name_order_with_optional_logs(tmp_path):
    write_drive(tmp_path / "b", 1, untuned=False)
    write_drive(tmp_path / "a", 2)
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


def test_invalid_folders_are_explained(tmp_path):
    with pytest.raises(RequestError, match=r"nowhere: no such folder"):
        read_drives(tmp_path / "nowhere")
    with pytest.raises(RequestError, match="no drive in it"):
        read_drives(tmp_path)
    folder = write_drive(tmp_path / "a", 1)
    (folder / "sim.tum").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(RequestError, match=r"a: sim\.csv, sim\.tum; only one sim log is allowed"):
        read_drives(tmp_path)
    (folder / "sim.tum").unlink()
    (folder / "sim.csv").unlink()
    with pytest.raises(RequestError, match=r"a: no sim\.\* in it"):
        read_drives(tmp_path)


def store_of_instances(path: Path, columns: dict[str, np.ndarray], names: list[str]) -> Path:
    """An index that contains only instances."""
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
def store_with_odometry(tmp_path: Path) -> Path:
    """Trajectory a has mirrored odometry and timestamps, b has no odometry."""
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
    return store_of_instances(tmp_path / "s.s2r", columns, ["a"] * n + ["b"] * 5)


def test_mirrored_odometry_is_aligned_with_the_ground_truth(store_with_odometry):
    with s2rstore.open(store_with_odometry) as store:
        (drive,) = odometry(store)
        assert drive.name == "a"
        assert drive.real.time[0] == 100.0
        assert np.hypot(drive.sim.x - drive.real.x, drive.sim.y - drive.real.y).max() < 1e-9
        assert angles.distance(drive.sim.heading, drive.real.heading).max() < 1e-9
        (unaligned,) = odometry(store, rate=5.0, aligned=False)
        assert np.diff(unaligned.real.time) == pytest.approx(0.2)
        assert (
            np.hypot(unaligned.sim.x - unaligned.real.x, unaligned.sim.y - unaligned.real.y).min()
            > 0.1
        )
        with pytest.raises(RequestError, match="rate 0"):
            odometry(store, rate=0.0)


def test_missing_timestamps_or_odometry_are_reported(store_with_odometry, tiny_store):
    with s2rstore.open(tiny_store) as store, pytest.raises(RequestError, match="no trajectory has"):
        odometry(store, rate=1.0)
    with edit(store_with_odometry) as draft:
        draft.update("instance", {"trajectory": "a"}, {"timestamp": None})
    with (
        s2rstore.open(store_with_odometry) as store,
        pytest.raises(RequestError, match="declare the rate"),
    ):
        odometry(store)


def test_constant_positions_cannot_be_aligned():
    constant_position = (np.full(9, 2.0), np.full(9, 1.0))
    with pytest.raises(InconclusiveError, match="nothing to align by"):
        fit(constant_position, constant_position)
