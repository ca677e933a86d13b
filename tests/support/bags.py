"""Write ROS 1 and ROS 2 bags from motion logs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from s2rtools.motion_logs import Log

Topics = Mapping[str, tuple[str, Log]]
"""Message type and poses per topic."""
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"


def build_message(
    store: Any, message_type: str, log: Log, i: int, ros1: bool, stamped: bool = True,
    rise: float = 0.0,
) -> Any:  # fmt: skip
    types = store.types
    ns = round(log.time[i] * 1e9) if stamped else 0
    stamp = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
    extra = {"seq": i} if ros1 else {}
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="odom", **extra)
    position = types["geometry_msgs/msg/Point"](x=log.x[i], y=log.y[i], z=rise * i)
    z, w = np.sin(log.heading[i] / 2), np.cos(log.heading[i] / 2)
    orientation = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=z, w=w)
    pose = types["geometry_msgs/msg/Pose"](position=position, orientation=orientation)
    if message_type == POSE:
        return types[POSE](header=header, pose=pose)
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = types["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
    covariance = np.zeros(36)
    return types[ODOMETRY](
        header=header,
        child_frame_id="base",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=covariance),
    )


def write(path: Path, topics: Topics, stamped: bool = True, rise: float = 0.0) -> Path:
    """Write a ROS 1 bag if the name ends in ".bag", else a ROS 2 folder ("mcap" selects MCAP).

    `rise` is the difference of z from each pose to the next.
    """
    ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        writer = Writer1(path)
    else:
        plugin = StoragePlugin["MCAP" if "mcap" in path.name else "SQLITE3"]
        writer = Writer2(path, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    with writer as bag:
        for topic, (message_type, log) in topics.items():
            connection = bag.add_connection(topic, message_type, typestore=store)
            for i in range(log.time.size):
                content = build_message(store, message_type, log, i, ros1, stamped, rise)
                bag.write(
                    connection,
                    round(log.time[i] * 1e9) + 5_000_000,
                    serialize(content, message_type),
                )
    return path
