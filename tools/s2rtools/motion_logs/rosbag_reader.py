"""Motion logs from ROS bags: ROS 1 `.bag`, ROS 2 folders and their `.db3` or `.mcap` files.

Poses come from one topic of `nav_msgs/Odometry`, `geometry_msgs/PoseStamped` or
`geometry_msgs/PoseWithCovarianceStamped`. Times come from the message headers, or from the
recording where all header times are zero.
"""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.common.bag_messages import POSES, BagMessages, pose_of, stamp_of
from s2rtools.motion_logs import row_checks
from s2rtools.motion_logs.motion_log import Log
from s2rtools.motion_logs.tum_reader import yaw

_MOST_POSES = 2_000_000
"""Five hours at 100 Hz."""
_NUMBERS = 9


def read(path: Path, topic: str | None = None) -> Log:
    """The poses of `topic`, by default of the only topic with poses.

    Raises RequestError where the bag is damaged, has no such topic, or has several and `topic` is
    None.
    """
    bag = BagMessages(path)
    topic = _topic(bag, topic)
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


def _topic(bag: BagMessages, topic: str | None) -> str:
    usable = sorted(name for name, kind in bag.types.items() if kind in POSES)
    if topic is not None:
        if topic not in bag.types:
            known = ", ".join(usable) or "none with poses"
            raise RequestError(f"{bag.path}: no topic {topic} (has: {known})")
        if topic not in usable:
            kind = bag.types[topic]
            raise RequestError(f"{bag.path}: topic {topic} is {kind}, which holds no poses")
        return topic
    if not usable:
        raise RequestError(f"{bag.path}: no topic with poses (Odometry or PoseStamped)")
    if len(usable) > 1:
        raise RequestError(
            f"{bag.path}: several topics have poses; name one of {', '.join(usable)} (--topic)"
        )
    return usable[0]
