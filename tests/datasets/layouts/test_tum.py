from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.datasets.helpers import kinds
from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import assert_found, only, read_with, reported
from tests.datasets.layouts.recordings import Frame, drive, edit, tum_pose
from tests.support.refusals import refused

TIMES = [1305031102.175304 + 0.1 * number for number in range(5)]
OTHER_SIZE = {"intrinsics of another size": 1}


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, list[Frame]]:
    folder = tmp_path / "rgbd_dataset_freiburg2_desk"
    return folder, recordings.tum(folder, drive(0.1 * k for k in range(5)), TIMES)


def test_depth_is_in_metres_with_z_up(recording):
    found = read_with("tum", recording[0])
    assert found.depth_scale == pytest.approx(1 / 5000)
    assert found.up == (0, 0, 1)
    assert found.is_metric
    depth = only(found).frames[0].depth.read()
    assert depth.pixels.dtype == np.uint16
    assert depth.pixels.max() * found.depth_scale <= 5.0


@pytest.mark.parametrize(
    ("row", "kind"),
    [
        ("nan 1 2 3 0 0 0 1", "bad time"),
        ("1305031102.5 nan 2 3 0 0 0 1", "bad pose"),
        ("1305031102.5 1 2 3 0 0 0 0", "bad pose"),
        ("1305031102.5 1 2 3 0 0 0", "bad row"),
        ("1305031102.5 1 2 3 0 0 0 1 1", "bad row"),
        ("1305031102.5 1 2 x 0 0 0 1", "bad row"),
    ],
)
def test_unusable_poses_are_reported_with_their_line(recording, row, kind):
    folder, frames = recording
    edit(folder / "groundtruth.txt", lambda lines: lines.append(row))
    found = read_with("tum", folder)
    assert_found(only(found), frames)
    assert kinds(found) == {kind: 1} | OTHER_SIZE
    assert reported(found, kind) == ["groundtruth.txt:7"]


def test_an_image_whose_pose_is_unusable_is_left_out(recording):
    folder, frames = recording

    def spoil(lines: list[str]) -> None:
        fields = lines[2].split()
        lines[2] = " ".join([*fields[:4], "0.3", "0.3", "0.3", "0.3"])

    edit(folder / "groundtruth.txt", spoil)
    found = read_with("tum", folder)
    assert_found(only(found), frames[:1] + frames[2:])
    assert reported(found, "bad pose") == ["groundtruth.txt:3"]
    assert reported(found, "no pose") == [frames[1].rgb]
    (norm,) = [issue.detail for issue in found.issues if issue.kind == "bad pose"]
    assert "0.6" in norm


@pytest.mark.parametrize(("offset", "count"), [(0.019, 5), (-0.019, 5), (0.021, 0)])
def test_single_poses_count_within_20_ms(recording, offset, count):
    folder, frames = recording
    rows = [f"{frame.time + offset:.6f} {tum_pose(frame.pose)}" for frame in frames]
    recordings.write_lines(folder / "groundtruth.txt", rows)
    if count:
        assert_found(only(read_with("tum", folder)), frames)
    else:
        with refused("no pose", "20 ms", "0.021 s"):
            read_with("tum", folder)


def test_an_image_without_depth_within_20_ms_is_reported(recording):
    folder, frames = recording
    edit(folder / "depth.txt", lambda lines: lines.pop(3))
    found = read_with("tum", folder)
    assert_found(only(found), frames[:2] + frames[3:])
    (issue,) = [issue for issue in found.issues if issue.kind == "no depth image"]
    assert issue.file == frames[2].rgb
    assert "0.096 s" in issue.detail


def test_one_depth_image_belongs_to_one_rgb_image(recording):
    folder, frames = recording
    recordings.write_rgb(folder / "rgb/extra.png", 99)
    edit(folder / "rgb.txt", lambda lines: lines.append(f"{TIMES[4] + 0.010:.6f} rgb/extra.png"))
    found = read_with("tum", folder)
    assert_found(only(found), frames)
    assert reported(found, "no depth image") == ["rgb/extra.png"]


@pytest.mark.parametrize("name", ["rgb.txt", "groundtruth.txt"])
def test_a_list_that_is_missing_or_of_other_content_is_named(recording, name):
    (recording[0] / name).unlink()
    with refused(name):
        read_with("tum", recording[0])
    for content in (b"# nothing\n", "1 rgb/a.png".encode("utf-16"), b"\0" * 99):
        (recording[0] / name).write_bytes(content)
        with refused(name):
            read_with("tum", recording[0])


@pytest.mark.parametrize(
    ("folder", "camera"),
    [
        ("rgbd_dataset_freiburg1_xyz", (517.3, 516.5, 318.6, 255.3)),
        ("fr3_office", (535.4, 539.2, 320.1, 247.6)),
        ("fr12", (525.0, 525.0, 319.5, 239.5)),
    ],
)
def test_the_calibration_follows_the_folder_name(tmp_path, folder, camera):
    path = tmp_path / folder
    frames = recordings.tum(path, drive([0.0]), TIMES[:1])
    Image.new("RGB", (640, 480), (9, 90, 200)).save(path / frames[0].rgb)
    found = read_with("tum", path)
    fx, fy, cx, cy = camera
    assert (found.camera.fx, found.camera.fy) == (fx, fy)
    assert (found.camera.cx, found.camera.cy) == (cx + 0.5, cy + 0.5)
    assert len(found.camera.distortion) == (5 if "freiburg1" in folder else 0)
    assert found.issues == []


def test_the_calibration_is_scaled_to_the_usual_size_of_images(recording):
    folder, frames = recording
    Image.new("RGB", (64, 48)).save(folder / frames[0].rgb)
    (folder / frames[1].rgb).write_bytes(b"no image")
    found = read_with("tum", folder)
    assert (found.camera.width, found.camera.height) == (32, 24)
    assert found.camera.fx == pytest.approx(520.9 / 20)
    assert found.camera.cx == pytest.approx((325.1 + 0.5) / 20)
    assert kinds(found) == OTHER_SIZE
    for frame in frames:
        (folder / frame.rgb).write_bytes(b"no image")
    with refused("no RGB image can be read"):
        read_with("tum", folder)


def test_option_camera_states_another(recording):
    found = read_with("tum", recording[0], camera="30,31,15.5,11.5")
    camera = found.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (30, 31, 16, 12)
    assert (camera.width, camera.height, camera.distortion) == (32, 24, ())
    assert found.issues == []
    scaled = read_with("tum", recording[0], camera="60,62,31.5,23.5,64,48").camera
    assert (scaled.fx, scaled.cx, scaled.width) == (30, 16, 32)


def test_unusable_options_are_refused(recording):
    for text in ("1,2,3", "a,b,c,d", "0,1,2,3", "nan,1,2,3", "1,1,1,1,0,2", ""):
        with refused("camera"):
            read_with("tum", recording[0], camera=text)
    with refused("no option 'cam'", "camera"):
        read_with("tum", recording[0], cam="1")
