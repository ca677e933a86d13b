from pathlib import Path

import numpy as np
import pytest

from tests.datasets.helpers import kinds
from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import assert_found, only, read_with, reported
from tests.datasets.layouts.recordings import Frame, drive, edit
from tests.support.refusals import refused

POSES = drive(0.1 * k for k in range(5))


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, list[Frame]]:
    return tmp_path / "dataset", recordings.kitti(tmp_path / "dataset", POSES)


@pytest.mark.parametrize("camera", [0, 1, 2])
def test_each_camera_has_its_own_place(tmp_path, camera):
    frames = recordings.kitti(tmp_path, POSES, camera)
    found = read_with("kitti", tmp_path, camera=str(camera))
    assert read_with("kitti", tmp_path).provenance["camera"] == f"image_{camera}"
    assert_found(only(found), frames)
    moved = np.linalg.norm(only(found).poses[0, :3, 3] - POSES[0][:3, 3])
    assert moved == pytest.approx(np.linalg.norm(recordings.KITTI_OFFSETS[camera]), abs=1e-5)


def test_the_camera_is_that_of_its_projection(recording):
    found = read_with("kitti", recording[0])
    camera = found.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (30, 30, 16, 12)
    assert (camera.width, camera.height, camera.distortion) == (32, 24, ())
    assert found.depth_camera is None
    assert found.up == (0, -1, 0)
    assert found.provenance["camera"] == "image_2"
    assert found.issues == []


def test_each_sequence_is_a_trajectory(recording):
    folder, first = recording
    second = recordings.kitti(folder, drive(0.2 * k for k in range(3)), sequence="08")
    found = read_with("kitti", folder)
    assert list(found.trajectories) == ["07", "08"]
    assert not found.has_one_world
    assert_found(found.trajectories["07"], first)
    assert_found(found.trajectories["08"], second)
    assert list(read_with("kitti", folder, trajectories=["08"]).trajectories) == ["08"]
    alone = read_with("kitti", folder / "sequences/08")
    assert alone.has_one_world
    assert list(alone.trajectories) == ["08"]
    assert_found(only(alone), second)


def test_sequences_of_other_cameras_are_read_one_by_one(recording):
    folder, first = recording
    recordings.kitti(folder, POSES, sequence="03")
    calibration = folder / "sequences/03/calib.txt"
    calibration.write_text(calibration.read_text().replace("3.0", "3.1"))
    with refused("sequences 03 and 07", "sequences/03"):
        read_with("kitti", folder)
    assert_found(only(read_with("kitti", folder / "sequences/07")), first)


def test_sequences_without_poses_are_reported(recording):
    folder, frames = recording
    recordings.kitti(folder, POSES, sequence="11")
    (folder / "poses/11.txt").unlink()
    found = read_with("kitti", folder)
    assert_found(only(found), frames)
    assert reported(found, "no poses") == ["sequences/11"]
    with refused("11.txt"):
        read_with("kitti", folder / "sequences/11")


def test_bad_rows_are_reported_and_do_not_shift_the_others(recording):
    folder, frames = recording

    def spoil(lines):
        lines[1] = "1 0 0"
        fields = lines[2].split()
        lines[2] = " ".join([*fields[:2], "5.0", *fields[3:]])

    edit(folder / "poses/07.txt", spoil)
    edit(folder / "sequences/07/times.txt", lambda lines: lines.__setitem__(3, "soon"))
    found = read_with("kitti", folder)
    assert_found(only(found), [frames[0], frames[4]])
    assert reported(found, "bad row") == ["sequences/07/times.txt:4", "poses/07.txt:2"]
    assert reported(found, "bad pose") == ["poses/07.txt:3"]
    assert reported(found, "no pose") == [frames[1].rgb]
    assert reported(found, "no time") == [frames[3].rgb]


def test_fewer_poses_and_times_than_images_and_times_in_disorder_are_reported(recording):
    folder, frames = recording
    edit(folder / "poses/07.txt", lambda lines: lines.pop())
    edit(folder / "sequences/07/times.txt", lambda lines: lines.__delitem__(slice(3, 5)))
    found = read_with("kitti", folder)
    assert_found(only(found), frames[:3])
    assert kinds(found) == {"no pose": 1, "no time": 1}
    edit(folder / "sequences/07/times.txt", lambda lines: lines.reverse())
    found = read_with("kitti", folder)
    assert [frame.rgb.name for frame in only(found).frames] == [f.rgb for f in frames[:3]]
    assert kinds(found)["times not in order"] == 1


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("P2:", "Q2:", "no line P2"),
        ("P2: 3.0", "P2: x", "calib.txt:3"),
        ("P2: 3.0", "P2: nan 3.0", "12 finite"),
        ("P2: 3.0", "P2: -3.0", "no projection"),
    ],
)
def test_unusable_calibrations_are_refused(recording, old, new, text):
    path = recording[0] / "sequences/07/calib.txt"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with refused("calib.txt", text):
        read_with("kitti", recording[0])


def test_an_unknown_camera_is_refused(recording):
    with refused("camera=5"):
        read_with("kitti", recording[0], camera="5")
    with refused("image_1"):
        read_with("kitti", recording[0], camera="1")
