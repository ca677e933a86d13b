"""ROS 1 and ROS 2 bags: writing and reading."""

import numpy as np
import pytest

from bench.support import robot
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.motion_logs import Log, read
from tests.support.bags import ODOMETRY, POSE, write
from tests.support.refusals import refused


@pytest.fixture(scope="module")
def log() -> Log:
    return robot.sampled(robot.drive(robot.commands(3.0, np.random.default_rng(3))), 20.0)


@pytest.mark.parametrize("name", ["a.bag", "folder", "mcap_folder"])
@pytest.mark.parametrize("message_type", [ODOMETRY, POSE])
def test_poses_are_read_with_their_header_timestamps(tmp_path, log, name, message_type):
    loaded = read(write(tmp_path / name, {"/odom": (message_type, log)}))
    assert loaded.time == pytest.approx(log.time, abs=1e-8)
    assert loaded.x == pytest.approx(log.x)
    assert angles.distance(loaded.heading, log.heading).max() < 1e-9


def test_missing_stamps_are_replaced_by_recording_times(tmp_path, log):
    loaded = read(write(tmp_path / "a.bag", {"/odom": (ODOMETRY, log)}, stamped=False))
    assert loaded.time == pytest.approx(log.time + 0.005, abs=1e-8)


def with_columns(log: Log, **columns: np.ndarray) -> Log:
    """The log with replaced columns, without validation."""
    columns_of_log = {n: columns.get(n, getattr(log, n)) for n in ("time", "x", "y", "heading")}
    return Log(**columns_of_log, source="", sha256="")


def test_errors_name_topic_and_message(tmp_path, log):
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
    with pytest.raises(RequestError, match="no topic with poses"):
        read(path)


def test_damaged_and_missing_bags_are_rejected_in_one_line(tmp_path, log):
    content = write(tmp_path / "a.bag", {"/odom": (ODOMETRY, log)}).read_bytes()
    (tmp_path / "cut.bag").write_bytes(content[: len(content) // 2])
    (tmp_path / "empty.db3").write_bytes(b"")
    (tmp_path / "text.mcap").write_bytes(b"not a bag at all" * 50)
    for name, message in (
        ("cut.bag", r"cut\.bag: .*its index is missing or damaged"),
        ("empty.db3", "cannot be read as a ROS bag"),
        ("text.mcap", "cannot be read as a ROS bag"),
        ("", r"no metadata\.yaml"),
        ("gone.bag", "no such bag"),
    ):
        with refused(match=message):
            read(tmp_path / name)


def test_a_bag_whose_z_does_not_point_up_is_refused(tmp_path, log):
    path = write(tmp_path / "a.bag", {"/odom": (POSE, log)}, rise=0.5)
    with pytest.raises(RequestError, match=r"a\.bag: z spans .* m where .* z must point up"):
        read(path)
