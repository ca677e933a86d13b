import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import assert_found, only, read_with
from tests.datasets.layouts.recordings import Frame, drive, turn
from tests.support.refusals import refused

COUNT = 4
TIMES = [1305031102.175304 + 0.1 * number for number in range(COUNT)]
STAMPS = [1403636579763555584 + 50_000_000 * number for number in range(COUNT)]


def write(layout: str, folder: Path, poses: list[np.ndarray]) -> tuple[Path, list[Frame]]:
    count = len(poses)
    if layout == "tum":
        return folder, recordings.tum(folder, poses, TIMES[:count])
    if layout == "7scenes":
        return folder, recordings.seven_scenes(folder, poses)
    if layout == "scannet":
        return folder, recordings.scannet(folder, poses)
    if layout == "euroc":
        return folder, recordings.euroc(folder, poses, STAMPS[:count])
    if layout == "kitti":
        return folder, recordings.kitti(folder, poses)
    return folder / "side.csv", recordings.csv(folder / "side.csv", poses, TIMES[:count])


NAMES = ["tum", "7scenes", "scannet", "euroc", "kitti", "csv"]


coordinates = st.tuples(*[st.floats(-50, 50)] * 3)
axes = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1)
pose_parts = st.lists(st.tuples(coordinates, axes, st.floats(-3.14, 3.14)), min_size=1, max_size=3)


@pytest.mark.parametrize("layout", NAMES)
@given(parts=pose_parts)
@settings(max_examples=15)
def test_any_pose_is_found(layout, parts):
    poses = []
    for position, axis, angle in parts:
        pose = np.eye(4)
        pose[:3, :3] = turn(np.array(axis) / np.linalg.norm(axis), angle)
        pose[:3, 3] = position
        poses.append(pose)
    with tempfile.TemporaryDirectory() as folder:
        path, frames = write(layout, Path(folder) / "recording", poses)
        recording = read_with(layout, path)
        assert_found(only(recording), frames)
        assert recording.layout == layout
        assert recording.root.is_dir()
        assert recording.name
        assert {issue.kind for issue in recording.issues} <= {"intrinsics of another size"}


@pytest.mark.parametrize(
    ("layout", "reader", "file"),
    [
        ("tum", "read_tum_trajectory_file", "groundtruth.txt"),
        ("euroc", "read_euroc_csv_trajectory", "mav0/state_groundtruth_estimate0/data.csv"),
        ("kitti", "read_kitti_poses_file", "poses/07.txt"),
    ],
)
def test_evo_reads_the_written_poses(layout, reader, file, tmp_path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    poses = np.array(drive(0.1 * k for k in range(COUNT)))
    write(layout, tmp_path, list(poses))
    found = getattr(file_interface, reader)(str(tmp_path / file)).poses_se3
    mount = recordings.camera_in_body() if layout == "euroc" else np.eye(4)
    np.testing.assert_allclose(found @ mount, poses, atol=1e-5)


@pytest.mark.parametrize("layout", NAMES)
def test_a_folder_of_something_else_is_refused(layout, tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    with refused():
        read_with(layout, tmp_path)
    with refused("no such f"):
        read_with(layout, tmp_path / "absent")
    with refused():
        read_with(layout, tmp_path / "notes.txt")


@pytest.mark.parametrize("layout", NAMES)
def test_an_unknown_trajectory_is_refused(layout, tmp_path):
    path, _ = write(layout, tmp_path / "recording", drive([0.0]))
    with refused("no_such"):
        read_with(layout, path, trajectories=["no_such"])


@pytest.mark.parametrize("layout", NAMES)
def test_a_link_out_of_the_recording_is_refused(layout, tmp_path):
    path, frames = write(layout, tmp_path / "recording", drive(0.1 * k for k in range(COUNT)))
    root = read_with(layout, path).root
    image = root / frames[0].rgb
    secret = tmp_path / f"secret{image.suffix}"
    image.rename(secret)
    image.symlink_to(secret)
    with refused("allow-outside"):
        read_with(layout, path)
    recording = read_with(layout, path, allow_outside=True)
    assert_found(only(recording), frames)
    assert recording.outside_folders == {str(tmp_path.resolve()): 1}


@pytest.mark.parametrize("layout", NAMES)
def test_a_missing_image_is_reported_and_left_out(layout, tmp_path):
    path, frames = write(layout, tmp_path / "recording", drive(0.1 * k for k in range(COUNT)))
    root = read_with(layout, path).root
    lost = frames[2].depth or frames[2].rgb
    (root / lost).unlink()
    recording = read_with(layout, path)
    assert_found(only(recording), frames[:2] + frames[3:])
    assert any(issue.file in (lost, frames[2].rgb) for issue in recording.issues)
    for frame in frames:
        (root / frame.rgb).unlink(missing_ok=True)
    with refused("no usable image"):
        read_with(layout, path)


@pytest.mark.parametrize("layout", ["tum", "7scenes", "scannet", "csv"])
def test_a_recording_that_lacks_depth_says_how_it_is_read_without(layout, tmp_path):
    path, frames = write(layout, tmp_path / "recording", drive(0.1 * k for k in range(COUNT)))
    root = path if path.is_dir() else path.parent
    for frame in frames:
        (root / str(frame.depth)).unlink()
    with refused("option depth=none reads the colour images alone"):
        read_with(layout, path)
    folder = (root / str(frames[0].depth)).parent
    if not any(folder.iterdir()):
        folder.rmdir()
    (root / "depth.txt").unlink(missing_ok=True)
    with refused("option depth=none reads the colour images alone"):
        read_with(layout, path)
    with refused("option depth=all"):
        read_with(layout, path, depth="all")
    for frame in frames:
        frame.depth = frame.depth_sha256 = None
    recording = read_with(layout, path, depth="none")
    assert_found(only(recording), frames)
    assert recording.depth_camera is None
