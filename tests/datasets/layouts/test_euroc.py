from pathlib import Path

import numpy as np
import pytest

from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import assert_found, only, read_with, reported
from tests.datasets.layouts.recordings import Frame, camera_in_body, drive, euroc_pose
from tests.support.refusals import refused

STAMPS = [1403636579763555584 + 50_000_000 * number for number in range(5)]
POSES = drive(0.05 * k for k in range(5))
TRUTH = "mav0/state_groundtruth_estimate0/data.csv"
SENSOR = "mav0/cam0/sensor.yaml"


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, list[Frame]]:
    return tmp_path / "MH_01_easy", recordings.euroc(tmp_path / "MH_01_easy", POSES, STAMPS)


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_the_camera_is_that_of_its_sensor_file(recording):
    found = read_with("euroc", recording[0])
    camera = found.camera
    assert (camera.width, camera.height) == (32, 24)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (30.5, 31.0, 15.7, 11.6)
    assert camera.distortion == (-0.28, 0.07, 0.0002, 1.8e-05)
    assert not camera.is_fisheye
    assert found.depth_camera is None
    assert found.up == (0, 0, 1)
    assert found.issues == []
    replace(recording[0] / SENSOR, "radial-tangential", "equidistant")
    assert read_with("euroc", recording[0]).camera.is_fisheye


def test_the_folder_mav0_itself_is_read(recording):
    folder, frames = recording
    assert_found(only(read_with("euroc", folder / "mav0")), frames)


def test_another_camera_is_chosen_by_option(tmp_path):
    frames = recordings.euroc(tmp_path, POSES, STAMPS, camera=1)
    assert_found(only(read_with("euroc", tmp_path, camera="1")), frames)
    with refused("mav0/cam0", "has: cam1"):
        read_with("euroc", tmp_path)
    with refused("option camera", "cam../x"):
        read_with("euroc", tmp_path, camera="../x")
    with refused("option poses", "state_groundtruth_estimate0"):
        read_with("euroc", tmp_path, camera="1", poses="leica0")


def test_poses_between_rows_are_interpolated(recording):
    folder, frames = recording
    times = np.arange(-1, 50) * 0.005 + 0.0013
    mount = np.linalg.inv(camera_in_body())
    rows = [
        f"{STAMPS[0] + round(time * 1e9)},{euroc_pose(pose @ mount)}"
        for time, pose in zip(times, drive(times), strict=True)
    ]
    recordings.write_lines(folder / TRUTH, rows)
    assert_found(only(read_with("euroc", folder)), frames)


def test_images_outside_of_the_ground_truth_are_reported(recording):
    folder, frames = recording
    lines = (folder / TRUTH).read_text().splitlines()
    (folder / TRUTH).write_text("\n".join([lines[0], *lines[2:]]) + "\n")
    found = read_with("euroc", folder)
    assert_found(only(found), frames[1:])
    assert reported(found, "no pose") == [frames[0].rgb]
    assert "0.050 s" in found.issues[0].detail


def test_the_pose_of_the_tracked_sensor_is_undone(recording):
    folder, frames = recording
    marker = np.eye(4)
    marker[:3, :3] = recordings.turn((0.6, 0.0, 0.8), 0.7)
    marker[:3, 3] = 0.05, -0.02, 0.11
    sensor = np.linalg.inv(camera_in_body()) @ marker
    rows = [f"{s},{euroc_pose(f.pose @ sensor)}" for s, f in zip(STAMPS, frames, strict=True)]
    recordings.write_lines(folder / "mav0/vicon0/data.csv", rows)
    recordings.write_sensor(folder / "mav0/vicon0/sensor.yaml", marker)
    assert_found(only(read_with("euroc", folder, poses="vicon0")), frames)


def test_bad_rows_are_reported_with_their_line(recording):
    folder, frames = recording
    with (folder / TRUTH).open("a") as file:
        file.write(f"{STAMPS[0]},0,0,0,1,0,0,0\n1,nan,0,0,1,0,0,0\n2,0,0,0,2,0,0,0\n3,0,0\n")
    with (folder / "mav0/cam0/data.csv").open("a") as file:
        file.write(f"{STAMPS[0]},again.png\nnan,x.png\nx,y.png\n7\n")
    found = read_with("euroc", folder)
    assert_found(only(found), frames)
    assert reported(found, "repeated time") == [f"{TRUTH}:7", "mav0/cam0/data.csv:7"]
    assert reported(found, "bad pose") == [f"{TRUTH}:8", f"{TRUTH}:9"]
    assert reported(found, "bad time") == ["mav0/cam0/data.csv:8"]
    assert len(reported(found, "bad row")) == 3


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("camera_model: pinhole", "camera_model: omni", "omni"),
        ("radial-tangential", "fov", "fov"),
        ("[30.5, 31.0, 15.2, 11.1]", "[30.5, 31.0]", "intrinsics"),
        ("[30.5, 31.0, 15.2, 11.1]", "[.nan, 31.0, 15.2, 11.1]", "fx"),
        ("resolution: [32, 24]", "resolution: [0, 24]", "pixels"),
        ("[-0.28, 0.07, 0.0002, 1.8e-05]", "[1, 2, 3]", "distortion"),
        ("T_BS:", "T_SB:", "T_BS"),
        ("data: [", "data: !!python/object/apply:os.system [", "YAML"),
    ],
)
def test_an_unusable_sensor_file_is_refused(recording, old, new, text):
    replace(recording[0] / SENSOR, old, new)
    with refused("sensor.yaml", text):
        read_with("euroc", recording[0])


def test_a_mount_that_is_no_rotation_is_refused(recording):
    no_pose = ["camera_model: pinhole", "intrinsics: [1, 1, 1, 1]"]
    recordings.write_sensor(recording[0] / SENSOR, 2 * np.eye(4), no_pose)
    with refused("sensor.yaml", "T_BS"):
        read_with("euroc", recording[0])
