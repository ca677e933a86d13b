"""Motion logs from ROS bags: ROS 1 `.bag`, ROS 2 folders and their `.db3` or `.mcap` files.

Poses come from one topic of `nav_msgs/Odometry`, `geometry_msgs/PoseStamped` or
`geometry_msgs/PoseWithCovarianceStamped`. Times come from the message headers, or from the
recording where all header times are zero.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.security.memory_limit import bounded_memory
from s2rtools.common.bag_files import LARGEST_UNPACKED, READING_MEMORY, check_bag, refusing_damage
from s2rtools.motion_logs import row_checks
from s2rtools.motion_logs.motion_log import Log
from s2rtools.motion_logs.tum_reader import yaw

_MOST_POSES = 2_000_000
"""Five hours at 100 Hz."""
_NUMBERS = 9

_POSES: dict[str, Callable[[Any], Any]] = {
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
}


def read(path: Path, topic: str | None = None) -> Log:
    """The poses of `topic`, by default of the only topic with poses.

    Raises RequestError where the bag is damaged, has no such topic, or has several and `topic` is
    None.
    """
    check_bag(path)
    with refusing_damage(path), bounded_memory(READING_MEMORY, LARGEST_UNPACKED):
        topic, rows = _messages(path, topic)
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


def _messages(path: Path, topic: str | None) -> tuple[str, array[float]]:
    """The topic, and for each message header and recording time (ns), position and quaternion."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    rows = array("d")
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        chosen = _topic(path, reader.connections, topic)
        connections = [each for each in reader.connections if each.topic == chosen]
        for connection, recorded, raw in reader.messages(connections):
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            pose = _POSES[connection.msgtype](message)
            p, q = pose.position, pose.orientation
            header_time = stamp.sec * 10**9 + stamp.nanosec
            rows.extend((header_time, recorded, p.x, p.y, p.z, q.x, q.y, q.z, q.w))
            if len(rows) > _NUMBERS * _MOST_POSES:
                raise RequestError(f"{path}: more than {_MOST_POSES:,} poses; split the bag")
    return chosen, rows


def _topic(path: Path, connections: list[Any], topic: str | None) -> str:
    kinds = {each.topic: each.msgtype for each in connections}
    usable = sorted(name for name, kind in kinds.items() if kind in _POSES)
    if topic is not None:
        if topic not in kinds:
            known = ", ".join(usable) or "none with poses"
            raise RequestError(f"{path}: no topic {topic} (has: {known})")
        if topic not in usable:
            raise RequestError(f"{path}: topic {topic} is {kinds[topic]}, which holds no poses")
        return topic
    if not usable:
        raise RequestError(f"{path}: no topic with poses (Odometry or PoseStamped)")
    if len(usable) > 1:
        raise RequestError(
            f"{path}: several topics have poses; name one of {', '.join(usable)} (--topic)"
        )
    return usable[0]
