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
from s2rtools.motion_logs.drives import odometry
from s2rtools.motion_logs.motion_log import fit_transform


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


@pytest.fixture
def store_with_odometry(store_copy: Path) -> Path:
    """Trajectory a has mirrored odometry and timestamps, b has no odometry."""
    with edit(store_copy) as draft:
        draft.rows(
            "UPDATE instance SET odom_x = 3 + y, odom_y = x - 2, odom_heading = pi() / 2 - heading,"
            " timestamp = 100 + seq / 5 WHERE trajectory = 'a' RETURNING iid"
        )
    return store_copy


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
        fit_transform(constant_position, constant_position)
