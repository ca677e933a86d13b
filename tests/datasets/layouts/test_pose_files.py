"""7-Scenes and ScanNet, whose poses lie in one file for each image."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.datasets.helpers import kinds
from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import assert_found, only, read_with, reported
from tests.datasets.layouts.recordings import Frame, drive, matrix_text, write_lines
from tests.support.refusals import refused

POSES = drive(0.1 * k for k in range(4))


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Path, dict[str, list[Frame]]]:
    folder = tmp_path / "chess"
    frames = {f"seq-{n:02d}": recordings.seven_scenes(folder, POSES, n) for n in (1, 2, 3)}
    write_lines(folder / "TrainSplit.txt", ["sequence1", "sequence3"])
    write_lines(folder / "TestSplit.txt", ["sequence2"])
    return folder, frames


@pytest.fixture
def scan(tmp_path: Path) -> tuple[Path, list[Frame]]:
    return tmp_path / "scene0000_00", recordings.scannet(tmp_path / "scene0000_00", POSES)


def test_each_sequence_is_a_trajectory(scene):
    folder, frames = scene
    found = read_with("7scenes", folder)
    assert list(found.trajectories) == ["seq-01", "seq-02", "seq-03"]
    for name, trajectory in found.trajectories.items():
        assert_found(trajectory, frames[name])
    chosen = read_with("7scenes", folder, trajectories=["seq-02"])
    assert list(chosen.trajectories) == ["seq-02"]


def test_a_split_names_its_sequences(scene):
    folder, _ = scene
    assert list(read_with("7scenes", folder, split="train").trajectories) == ["seq-01", "seq-03"]
    assert list(read_with("7scenes", folder, split="test").trajectories) == ["seq-02"]
    write_lines(folder / "TestSplit.txt", ["sequence2", "sequence9"])
    assert reported(read_with("7scenes", folder, split="test"), "missing sequence") == ["seq-09"]
    with refused("split=all", "train"):
        read_with("7scenes", folder, split="all")
    write_lines(folder / "TestSplit.txt", ["all of them"])
    with refused("TestSplit.txt:1"):
        read_with("7scenes", folder, split="test")
    (folder / "TestSplit.txt").unlink()
    with refused("TestSplit.txt"):
        read_with("7scenes", folder, split="test")


def test_one_sequence_is_read_alone(scene):
    folder, frames = scene
    found = read_with("7scenes", folder / "seq-02")
    for frame in frames["seq-02"]:
        frame.rgb = Path(frame.rgb).name
        frame.depth = Path(str(frame.depth)).name
    assert list(found.trajectories) == ["seq-02"]
    assert_found(only(found), frames["seq-02"])


def test_7_scenes_has_two_cameras_and_no_known_gravity(scene):
    folder, _frames = scene
    for number in range(4):
        Image.new("RGB", (640, 480)).save(folder / f"seq-01/frame-{number:06d}.color.png")
        Image.new("I;16", (640, 480)).save(folder / f"seq-01/frame-{number:06d}.depth.png")
    found = read_with("7scenes", folder)
    assert (found.camera.fx, found.camera.cx, found.camera.cy) == (525, 320, 240)
    depth = found.depth_camera
    assert (depth.fx, depth.fy, depth.cx, depth.cy) == (585, 585, 320, 240)
    assert (found.depth_scale, found.depth_raw_max) == (0.001, 65534)
    assert found.up is None
    stated = read_with("7scenes", folder, camera="500,500,319.5,239.5", depth_camera="1,1,1,1")
    assert (stated.camera.fx, stated.depth_camera.fx) == (500, 1)


BAD_POSES = {
    "1 0 0 0 0 1 0 0 0 0 1 nan 0 0 0 1": "not finite",
    "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1": "axes is 2, expected 1",
    "2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1": "orthonormal",
    "-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1": "mirrors",
    "1 0 0 0 0 1 0 0 0 0 1 0": "12 values",
    "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 one": "one",
    "": "0 values",
    "1 0 0 2e7 0 1 0 0 0 0 1 0 0 0 0 1": "from the origin",
    "1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1": "last row is 1 2 3 1",
}


@pytest.mark.parametrize("text", BAD_POSES)
def test_bad_poses_are_reported(scan, text):
    folder, frames = scan
    (folder / "pose/1.txt").write_text(text)
    found = read_with("scannet", folder)
    assert_found(only(found), frames[:1] + frames[2:])
    (issue,) = [issue for issue in found.issues if issue.kind == "bad pose"]
    assert issue.file == "pose/1.txt"
    assert BAD_POSES[text] in issue.detail


def test_a_frame_without_pose_or_depth_or_rgb_is_reported(scan):
    folder, frames = scan
    (folder / "pose/0.txt").unlink()
    (folder / "depth/1.png").unlink()
    (folder / "color/2.jpg").unlink()
    found = read_with("scannet", folder)
    assert_found(only(found), frames[3:])
    assert kinds(found) == {"no pose": 1, "no depth image": 1, "no RGB image": 1}
    assert [issue.file for issue in found.issues] == ["color/0.jpg", "color/1.jpg", "depth/2.png"]


def test_poses_of_minus_infinity_are_frames_without_tracking(scan):
    folder, frames = scan
    write_lines(folder / "pose/3.txt", matrix_text(np.full((4, 4), -np.inf)))
    found = read_with("scannet", folder)
    assert_found(only(found), frames[:3])
    assert kinds(found) == {"no pose": 1}
    assert reported(found, "no pose") == ["pose/3.txt"]


def test_scannet_has_the_exported_intrinsics(scan):
    found = read_with("scannet", scan[0])
    camera, depth = found.camera, found.depth_camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (30, 31, 16, 12)
    assert (camera.width, camera.height) == (32, 24)
    assert (depth.fx, depth.fy) == (28, 29)
    assert (found.depth_scale, found.up) == (0.001, (0, 0, 1))
    assert found.issues == []


def test_intrinsics_beside_the_folders_are_read(scan):
    folder, _frames = scan
    for kind in ("color", "depth"):
        (folder / f"intrinsic/intrinsic_{kind}.txt").rename(folder / f"intrinsics_{kind}.txt")
    assert read_with("scannet", folder).camera.fx == 30
    (folder / "intrinsics_depth.txt").unlink()
    with refused("intrinsic_depth.txt", "missing"):
        read_with("scannet", folder)


@pytest.mark.parametrize("value", ["nan", "-30", "x"])
def test_unusable_intrinsics_are_refused(scan, value):
    path = scan[0] / "intrinsic/intrinsic_color.txt"
    path.write_text(path.read_text().replace("3.00000000e+01", value, 1))
    with refused("intrinsic_color.txt"):
        read_with("scannet", scan[0])


def test_an_extrinsic_that_is_not_the_identity_is_reported(scan):
    offset = np.eye(4)
    offset[0, 3] = 0.025
    write_lines(scan[0] / "intrinsic/extrinsic_color.txt", matrix_text(offset))
    found = read_with("scannet", scan[0])
    assert reported(found, "extrinsics ignored") == ["intrinsic/extrinsic_color.txt"]


def test_images_of_a_repeated_number_are_reported(scan):
    folder, _frames = scan
    recordings.write_rgb(folder / "color/00001.jpg", 77)
    found = read_with("scannet", folder)
    assert len(only(found).frames) == 4
    assert reported(found, "repeated image") == ["color/1.jpg"]


def test_the_usual_size_of_depth_images_counts(scan):
    folder, frames = scan
    Image.new("I;16", (9, 9)).save(folder / str(frames[0].depth))
    assert read_with("scannet", folder).depth_camera.width == 32
    for frame in frames:
        (folder / str(frame.depth)).write_bytes(b"")
    with refused("no depth image can be read"):
        read_with("scannet", folder)
