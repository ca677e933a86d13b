"""Poses of evo's public bags, as evo itself reads them.

`S2R_EVO_DATA` names the folder `test/data` of evo's source package.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from evo.tools.file_interface import read_bag_trajectory
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from s2rstore.errors import RequestError
from s2rtools.datasets import read
from s2rtools.datasets.bags.frame_tree import FrameTree, PoseLog
from s2rtools.datasets.bags.messages import BagMessages, stamp_of
from s2rtools.datasets.bags.topics import is_static

TOPICS = (
    ("ROS_example.bag", "groundtruth"),
    ("ROS_example.bag", "ORB-SLAM"),
    ("ROS_example.bag", "S-PTAM"),
    ("nav2_turtlebot.mcap", "/odom"),
    ("nav2_turtlebot.mcap", "/amcl_pose"),
)


@pytest.fixture
def folder() -> Path:
    if not os.environ.get("S2R_EVO_DATA"):
        pytest.skip("S2R_EVO_DATA does not name the folder `test/data` of evo's source package")
    return Path(os.environ["S2R_EVO_DATA"])


@pytest.mark.parametrize(("name", "topic"), TOPICS)
def test_poses_are_those_that_evo_reads(folder: Path, name: str, topic: str) -> None:
    bag, log = BagMessages(folder / name), PoseLog()
    for _, _, message in bag.all_of((topic,)):
        pose = getattr(message.pose, "pose", message.pose)
        log.add(stamp_of(message), pose.position, pose.orientation)
    times, poses, issues = log.ordered(0, topic)
    with (Reader1 if name.endswith(".bag") else Reader2)(folder / name) as reader:
        known = read_bag_trajectory(reader, topic)
    assert issues == []
    np.testing.assert_allclose(times, known.timestamps, atol=1e-6)
    np.testing.assert_allclose(poses, np.array(known.poses_se3), atol=1e-9)


def test_the_chain_of_a_turtlebots_camera_is_found(folder: Path) -> None:
    path = folder / "nav2_turtlebot.mcap"
    bag, tree = BagMessages(path), FrameTree(path)
    for topic, _, message in bag.all_of(("/tf", "/tf_static")):
        tree.add(message, is_static(topic))
    links = tree.chain("oakd_rgb_camera_optical_frame", None)
    assert [child for child, _ in links][-2:] == ["base_link", "odom"]
    assert links[-1][1] == "map"


def test_bags_without_images_end_in_one_line(folder: Path) -> None:
    with pytest.raises(RequestError, match=r"nav2_turtlebot\.mcap: no topic with RGB images"):
        read("bag", folder / "nav2_turtlebot.mcap")
