"""Poses equal those that evo's readers find, in written recordings and in evo's own test data.

evo's source package has test data, its wheel has not: trajectories of TUM RGB-D, EuRoC and KITTI.
Their tests run if the environment variable S2R_EVO_DATA names that package's folder `test/data`.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import angle, only, read_with
from tests.datasets.layouts.recordings import drive, write_lines

file_interface = pytest.importorskip("evo.tools.file_interface")
DATA = Path(os.environ.get("S2R_EVO_DATA", ""))
needs_data = pytest.mark.skipif("S2R_EVO_DATA" not in os.environ, reason="needs S2R_EVO_DATA")
STAMPS = [1403636579763555584 + 50_000_000 * number for number in range(6)]
SENSOR = [
    "camera_model: pinhole",
    "intrinsics: [30, 30, 16, 12]",
    "distortion_model: radial-tangential",
    "distortion_coefficients: [0, 0, 0, 0]",
]


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


@needs_data
@pytest.mark.parametrize(
    "name",
    [
        "freiburg1_xyz-groundtruth.txt",
        "fr2_desk_groundtruth.txt",
        "freiburg1_xyz-rgbdslam.txt",
        "fr2_desk_ORB.txt",
        "V102.txt",
    ],
)
def test_trajectories_of_tum_that_evo_ships(tmp_path: Path, name: str) -> None:
    known = file_interface.read_tum_trajectory_file(str(DATA / name))
    rows = range(0, known.num_poses, max(1, known.num_poses // 30))
    times = [known.timestamps[row] for row in rows]
    poses = [known.poses_se3[row] for row in rows]
    recordings.tum(tmp_path, poses, times)
    shutil.copy(DATA / name, tmp_path / "groundtruth.txt")
    assert_equal(only(read_with("tum", tmp_path)).poses, poses)


@needs_data
def test_the_sequence_of_kitti_that_evo_ships(tmp_path: Path) -> None:
    known = file_interface.read_kitti_poses_file(str(DATA / "KITTI_00_gt.txt"))
    recordings.kitti(tmp_path, known.poses_se3[:1], camera=0)
    for number in range(known.num_poses):
        (tmp_path / f"sequences/07/image_0/{number:06d}.png").touch()
    shutil.copy(DATA / "KITTI_00_gt.txt", tmp_path / "poses/07.txt")
    shutil.copy(DATA / "KITTI_00_gt_times.txt", tmp_path / "sequences/07/times.txt")
    found = read_with("kitti", tmp_path)
    assert_equal(only(found).poses, known.poses_se3)
    assert found.issues == []


@needs_data
def test_the_recording_of_euroc_that_evo_ships(tmp_path: Path) -> None:
    known = file_interface.read_euroc_csv_trajectory(str(DATA / "V102_groundtruth.csv"))
    lines = (DATA / "V102_groundtruth.csv").read_text().splitlines()[1:]
    rows = range(0, len(lines), 40)
    stamps = [int(lines[row].split(",")[0]) for row in rows]
    recordings.euroc(tmp_path, [known.poses_se3[row] for row in rows], stamps)
    write_lines(tmp_path / "mav0/state_groundtruth_estimate0/data.csv", lines)
    recordings.write_sensor(tmp_path / "mav0/cam0/sensor.yaml", np.eye(4), SENSOR)
    poses = only(read_with("euroc", tmp_path)).poses
    assert_equal(poses, [known.poses_se3[row] for row in rows])
