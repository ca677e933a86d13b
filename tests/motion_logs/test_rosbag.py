"""ROS 1 and ROS 2 bags: writing and reading."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.support import robot
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.motion_logs import Log, read
from tests.support.bags import ODOMETRY, POSE, write


@pytest.fixture(scope="module")
def log() -> Log:
    return robot.sampled(robot.drive(robot.commands(3.0, np.random.default_rng(3))), 20.0)


@pytest.mark.parametrize("name", ["a.bag", "folder", "mcap_folder"])
@pytest.mark.parametrize("message_type", [ODOMETRY, POSE])
def test_poses_are_read_with_their_header_timestamps(
    tmp_path: Path, log: Log, name: str, message_type: str
) -> None:
    loaded = read(write(tmp_path / name, {"/odom": (message_type, log)}))
    assert loaded.time == pytest.approx(log.time, abs=1e-8)
    assert loaded.x == pytest.approx(log.x)
    assert angles.distance(loaded.heading, log.heading).max() < 1e-9


@pytest.mark.parametrize("suffix", ["db3", "mcap"])
def test_a_file_inside_a_bag_folder_can_be_read(tmp_path: Path, log: Log, suffix: str) -> None:
    folder = write(tmp_path / f"{suffix}_folder", {"/odom": (ODOMETRY, log)})
    (file,) = folder.glob(f"*.{suffix}")
    assert read(file).y == pytest.approx(log.y)


def test_missing_stamps_are_replaced_by_recording_times(tmp_path: Path, log: Log) -> None:
    loaded = read(write(tmp_path / "a.bag", {"/odom": (ODOMETRY, log)}, stamped=False))
    assert loaded.time == pytest.approx(log.time + 0.005, abs=1e-8)


def test_one_of_several_topics_must_be_named(tmp_path: Path, log: Log) -> None:
    path = write(tmp_path / "bag", {"/odom": (ODOMETRY, log), "/truth": (POSE, log)})
    with pytest.raises(RequestError, match=r"name one of /odom, /truth"):
        read(path)
    assert read(path, "/truth").x == pytest.approx(log.x)
    with pytest.raises(RequestError, match=r"no topic /pose \(has: /odom, /truth\)"):
        read(path, "/pose")


def with_columns(log: Log, **columns: np.ndarray) -> Log:
    """The log with replaced columns, without validation."""
    columns_of_log = {n: columns.get(n, getattr(log, n)) for n in ("time", "x", "y", "heading")}
    return Log(**columns_of_log, source="", sha256="")


def test_errors_name_topic_and_message(tmp_path: Path, log: Log) -> None:
    x, time = log.x.copy(), log.time.copy()
    x[4] = np.nan
    time[7] = time[5]
    path = write(tmp_path / "nan.bag", {"/odom": (ODOMETRY, with_columns(log, x=x))})
    with pytest.raises(RequestError, match=r"nan\.bag: topic /odom, message 5: not a finite"):
        read(path)
    path = write(tmp_path / "clock", {"/odom": (ODOMETRY, with_columns(log, time=time))})
    with pytest.raises(RequestError, match=r"clock: topic /odom, message .: the clock"):
        read(path)
    empty = with_columns(log, **{n: np.zeros(0) for n in ("time", "x", "y", "heading")})
    path = write(tmp_path / "empty", {"/odom": (ODOMETRY, empty)})
    with pytest.raises(RequestError, match="topic /odom has no messages"):
        read(path)


@pytest.mark.parametrize("name", ["a.bag", "a.db3", "a.mcap"])
@pytest.mark.parametrize("content", [b"", b"not a bag at all" * 50])
def test_damaged_bags_are_rejected_in_one_line(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RequestError, match=r"cannot be read as a ROS bag") as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_truncated_and_missing_bags_are_rejected(tmp_path: Path, log: Log) -> None:
    content = write(tmp_path / "a.bag", {"/odom": (ODOMETRY, log)}).read_bytes()
    (tmp_path / "cut.bag").write_bytes(content[: len(content) // 2])
    with pytest.raises(RequestError, match=r"cut\.bag: .*its index is missing or damaged"):
        read(tmp_path / "cut.bag")
    with pytest.raises(RequestError, match=r"no metadata\.yaml"):
        read(tmp_path)
    with pytest.raises(RequestError, match="no such bag"):
        read(tmp_path / "gone.bag")


def test_a_bag_whose_z_does_not_point_up_is_refused(tmp_path: Path, log: Log) -> None:
    path = write(tmp_path / "a.bag", {"/odom": (POSE, log)}, rise=0.5)
    with pytest.raises(RequestError, match=r"a\.bag: z spans .* m where .* z must point up"):
        read(path)
