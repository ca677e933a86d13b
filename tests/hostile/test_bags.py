"""ROS bags that are decompression bombs, pipes or endless views."""

import bz2
import os
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from bench.support import robot
from s2rstore.errors import RequestError
from s2rtools.motion_logs import read
from tests.hostile.inputs import MAX_MEGABYTES, deadline, limits, s2r
from tests.support import bag_file, bags


@pytest.fixture(scope="module")
def topics() -> bags.Topics:
    log = robot.sampled(robot.drive(robot.commands(2.0, np.random.default_rng(3))), 20.0)
    return {"/odom": (bags.ODOMETRY, log)}


class BombWriter(Writer):
    """Writes chunks that inflate to 3 GB."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        zeros = bz2.compress(bytes(64 << 20))
        self.compression_format = "bz2"
        self.compressor = lambda data: bz2.compress(data) + 48 * zeros


def test_a_decompression_bomb_is_rejected(tmp_path, topics, monkeypatch):
    drive = tmp_path / "drives" / "one"
    drive.mkdir(parents=True)
    bags.write(drive / "sim.bag", topics)
    monkeypatch.setattr(bag_file, "Writer1", BombWriter)
    bags.write(drive / "real.bag", topics)
    assert (drive / "real.bag").stat().st_size < 100_000
    result = s2r(tmp_path, "sysid", tmp_path / "drives", "--out", tmp_path / "out")
    result.assert_rejected("real.bag", "split it")
    assert result.megabytes < MAX_MEGABYTES


def test_resource_limits_are_restored_after_reading_a_bag(tmp_path, topics):
    before = limits()
    read(bags.write(tmp_path / "a.bag", topics))
    (tmp_path / "b.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    with pytest.raises(RequestError):
        read(tmp_path / "b.bag")
    assert limits() == before


@pytest.mark.parametrize("name", ["a.bag", "a.db3", "a.mcap", "a.csv", "a.tum"])
def test_a_pipe_in_place_of_a_log_is_rejected(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with deadline(), pytest.raises(RequestError, match=f"{name}: a pipe, not a regular file"):
        read(tmp_path / name)


def test_a_pipe_or_a_link_inside_a_bag_is_rejected(tmp_path, topics):
    folder = bags.write(tmp_path / "folder", topics)
    (database,) = folder.glob("*.db3")
    database.rename(tmp_path / "moved.db3")
    database.symlink_to(tmp_path / "moved.db3")
    with pytest.raises(RequestError, match="outside the bag"):
        read(folder)
    database.unlink()
    os.mkfifo(database)
    with deadline(), pytest.raises(RequestError, match="a pipe"):
        read(folder)


@pytest.mark.parametrize("table", ["messages", "topics"])
def test_an_endless_view_in_place_of_a_table_is_rejected(tmp_path, topics, table):
    folder = bags.write(tmp_path / "folder", topics)
    (database,) = folder.glob("*.db3")
    with sqlite3.connect(database) as opened:
        names = [row[1] for row in opened.execute(f"PRAGMA table_info({table})")]
        opened.execute(f"ALTER TABLE {table} RENAME TO kept")
        endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
        columns = ", ".join(f"i AS {name}" for name in names)
        opened.execute(f"CREATE VIEW {table} AS {endless} SELECT {columns} FROM n")
    with deadline(), pytest.raises(RequestError, match=f"'{table}' is not a table"):
        read(folder)
