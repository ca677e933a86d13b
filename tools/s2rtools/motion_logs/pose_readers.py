"""Motion logs in TUM format, and from ROS bags.

A line of a TUM file is `time tx ty tz qx qy qz qw`. The poses of a bag (ROS 1 `.bag`, ROS 2 folders
and their `.db3` or `.mcap` files) come from one topic of `nav_msgs/Odometry`,
`geometry_msgs/PoseStamped` or `geometry_msgs/PoseWithCovarianceStamped`; times come from the
headers of messages, or from the recording where all header times are zero. The heading is the yaw.
z points up and is left out; poses that do not stay on a floor are refused.
"""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.bag_messages import POSES, BagMessages, choose_topic, pose_of, stamp_of
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import POSE_COLUMNS, read_numbers
from s2rtools.motion_logs import row_checks
from s2rtools.motion_logs.motion_log import Log

_MOST_POSES = 2_000_000
"""Five hours at 100 Hz."""
_NUMBERS = 9


def read_tum(path: Path) -> Log:
    """Read a log. Raises RequestError with the line number for an invalid file."""
    issues: list[InputIssue] = []
    rows = read_numbers(path, str(path), len(POSE_COLUMNS), issues)
    if issues:
        columns = " ".join(POSE_COLUMNS)
        raise RequestError(f"{issues[0].file}: {issues[0].detail}; a line has {columns}")
    for row, column in np.argwhere(~np.isfinite(rows.values))[:1].tolist():
        value = rows.values[row, column]
        raise RequestError(f"{rows.place(row)}: {POSE_COLUMNS[column]} is {value}; remove the row")
    heading = yaw(rows.values[:, 4:8], rows.place)
    poses = np.column_stack([rows.values[:, :3], heading])
    warnings = row_checks.check_floor(rows.values[:, 1:4], path)
    return row_checks.log(poses, path, rows.place, warnings)


def yaw(quaternions: NDArray[np.float64], place: row_checks.Place) -> NDArray[np.float64]:
    """Yaw (n,), rad, of quaternions (n, 4) x, y, z, w, which need not be normalised."""
    length = np.linalg.norm(quaternions, axis=1)
    zero = np.flatnonzero(length < 1e-9)
    if zero.size:
        raise RequestError(f"{place(int(zero[0]))}: the quaternion is 0; there is no heading")
    x, y, z, w = (quaternions / length[:, None]).T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def read_bag(path: Path, topic: str | None = None) -> Log:
    """The poses of `topic`, by default of the only topic with poses.

    Raises RequestError where the bag is damaged, has no such topic, or has several and `topic` is
    None.
    """
    bag = BagMessages(path)
    topic = choose_topic(path, bag.types, POSES, topic, ("poses", "--topic"))
    rows = array("d")
    for _, recorded, message in bag.all_of((topic,)):
        pose = pose_of(message)
        p, q = pose.position, pose.orientation
        rows.extend((stamp_of(message), recorded, p.x, p.y, p.z, q.x, q.y, q.z, q.w))
        if len(rows) > _NUMBERS * _MOST_POSES:
            raise RequestError(f"{path}: more than {_MOST_POSES:,} poses; split the bag")
    if not len(rows):
        raise RequestError(f"{path}: topic {topic} has no messages")

    def place(i: int) -> str:
        return f"{path}: topic {topic}, message {i + 1}"

    table = np.frombuffer(rows, dtype=np.float64).reshape(-1, _NUMBERS)
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if bad.size:
        raise RequestError(f"{place(int(bad[0]))}: not a finite pose; remove it")
    stamped = table[:, 0].any()
    time = (table[:, 0] if stamped else table[:, 1]) * 1e-9
    poses = np.column_stack([time, table[:, 2:4], yaw(table[:, 5:9], place)])
    return row_checks.log(poses, path, place, row_checks.check_floor(table[:, 2:5], path))
