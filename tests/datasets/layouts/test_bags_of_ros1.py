"""Bags that `rosbag` of ROS 1 wrote, where it is installed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from s2rtools.datasets import read
from s2rtools.ros.ros_environment import SYSTEM_PACKAGES
from tests.datasets.helpers import kinds
from tests.datasets.layouts.rooms import assert_poses, image, walk

PACKAGES = ("rosbag", "genpy", "sensor_msgs", "geometry_msgs")


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_bags_of_rosbag(tmp_path: Path, compression: str) -> None:
    missing = [name for name in PACKAGES if not (Path(SYSTEM_PACKAGES) / name).is_dir()]
    if missing:
        pytest.skip(f"ROS 1 is not installed: {', '.join(missing)} (see .ci/programs)")
    scene = walk(7)
    metres = scene.depth.astype(np.float32) / 1000
    metres[:, 0, 0] = np.nan
    np.savez(
        tmp_path / "walk.npz",
        times=np.rint(scene.times * 10).astype(np.int64) * 10**8,
        rgb=scene.rgb,
        metres=metres,
        positions=scene.poses[:, :3, 3],
        quaternions=Rotation.from_matrix(scene.poses[:, :3, :3]).as_quat(),
    )
    bag = tmp_path / "recorded.bag"
    program = Path(__file__).with_name("ros1_recorder.py")
    command = [sys.executable, program, SYSTEM_PACKAGES, bag, compression, tmp_path / "walk.npz"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if compression == "lz4" and "lz4" in done.stderr:
        pytest.skip(f"this rosbag has no lz4: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    recording = read("bag", bag)
    assert_poses(recording, scene.poses)
    assert kinds(recording) == {}
    assert recording.camera.cx == 12.0
    (trajectory,) = recording.trajectories.values()
    for row, frame in enumerate(trajectory.frames):
        np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[row])
        assert frame.depth is not None
        depth = image(frame.depth.read()).pixels
        assert depth[0, 0] == 0
        np.testing.assert_array_equal(depth.ravel()[1:], scene.depth[row].ravel()[1:])
