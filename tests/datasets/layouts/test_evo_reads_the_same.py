"""Poses of written recordings equal those that evo's readers find."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import angle, only, read_with
from tests.datasets.layouts.recordings import drive

file_interface = pytest.importorskip("evo.tools.file_interface")
STAMPS = [1403636579763555584 + 50_000_000 * number for number in range(6)]


def assert_equal(found: np.ndarray, expected: list[np.ndarray]) -> None:
    assert len(found) == len(expected)
    for pose, known in zip(found, expected, strict=True):
        assert np.linalg.norm(pose[:3, 3] - known[:3, 3]) < 1e-4
        assert angle(pose, known) < 0.01


def test_ground_truth_of_tum(tmp_path: Path) -> None:
    recordings.tum(tmp_path, drive(0.1 * k for k in range(6)), [1e9 + 0.1 * k for k in range(6)])
    known = file_interface.read_tum_trajectory_file(str(tmp_path / "groundtruth.txt"))
    assert_equal(only(read_with("tum", tmp_path)).poses, known.poses_se3)


def test_ground_truth_of_euroc(tmp_path: Path) -> None:
    recordings.euroc(tmp_path, drive(0.05 * k for k in range(6)), STAMPS)
    truth = tmp_path / "mav0/state_groundtruth_estimate0/data.csv"
    known = file_interface.read_euroc_csv_trajectory(str(truth))
    mount = recordings.camera_in_body()
    poses = only(read_with("euroc", tmp_path)).poses
    assert_equal(poses, [pose @ mount for pose in known.poses_se3])


def test_poses_of_kitti(tmp_path: Path) -> None:
    recordings.kitti(tmp_path, drive(0.1 * k for k in range(6)), camera=0)
    known = file_interface.read_kitti_poses_file(str(tmp_path / "poses/07.txt"))
    assert_equal(only(read_with("kitti", tmp_path)).poses, known.poses_se3)
