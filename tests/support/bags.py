"""Write ROS 1 and ROS 2 bags from motion logs."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from s2rtools.motion_logs import Log
from tests.support.bag_file import BagFile

Topics = Mapping[str, tuple[str, Log]]
"""Message type and poses per topic."""
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"


def write(path: Path, topics: Topics, stamped: bool = True, rise: float = 0.0) -> Path:
    """Write a bag whose messages are recorded 5 ms after their stamps.

    `rise` is the difference of z from each pose to the next.
    """
    bag = BagFile(path, latency=5_000_000)
    for topic, (kind, log) in topics.items():
        bag.topics[topic] = kind
        for i, time in enumerate(log.time):
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_euler("z", log.heading[i]).as_matrix()
            pose[:3, 3] = log.x[i], log.y[i], rise * i
            if kind == POSE:
                bag.pose(topic, round(time * 1e9), pose)
            else:
                bag.odometry(topic, round(time * 1e9), pose, "base")
            if not stamped:
                stamp = bag.items[-1][3].header.stamp
                stamp.sec = stamp.nanosec = 0
    return bag.write()
