import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.helpers import kinds
from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import assert_found, only, read_with, reported
from tests.datasets.layouts.recordings import Frame, drive, quaternion
from tests.support.refusals import refused

TIMES = [0.5 * number for number in range(4)]
POSES = drive(TIMES)


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, list[Frame]]:
    path = tmp_path / "lab.csv"
    return path, recordings.csv(path, POSES, TIMES)


def describe(path: Path, text: str) -> None:
    path.with_suffix(".toml").write_text(text)


def rows(path: Path) -> list[str]:
    return path.read_text().splitlines()


def test_the_camera_is_that_of_the_description(recording):
    path, _ = recording
    found = read_with("csv", path)
    camera = found.camera
    assert (camera.width, camera.height) == (32, 24)
    assert camera.fx == pytest.approx(16)
    assert (camera.cx, camera.cy) == (16, 12)
    assert (found.up, found.is_metric, found.depth_scale) == ((0, 0, 1), True, 0.001)
    assert list(found.trajectories) == ["lab"]
    describe(
        path,
        """
        distortion = [0.1, -0.2, 0.0, 0.001]
        depth_scale = 0.0002
        depth_raw_max = 50000
        up = [0, -1, 0]
        metric = false
        [camera]
        width = 32
        height = 24
        fx = 30.0
        fy = 31.0
        cx = 15.5
        cy = 12.5
        [depth_camera]
        width = 16
        height = 12
        hfov = 60
        """,
    )
    found = read_with("csv", path)
    assert (found.camera.fx, found.camera.cy) == (30, 12.5)
    assert found.camera.distortion == (0.1, -0.2, 0, 0.001)
    assert (found.depth_camera.width, found.depth_camera.distortion) == (16, ())
    assert (found.up, found.is_metric) == ((0, -1, 0), False)
    assert (found.depth_scale, found.depth_raw_max) == (0.0002, 50000)


def test_a_description_in_json_or_elsewhere_is_read(recording, tmp_path):
    path, frames = recording
    path.with_suffix(".toml").unlink()
    with refused("lab.toml", "missing"):
        read_with("csv", path)
    camera = {"camera": {"width": 32, "height": 24, "hfov": 90}}
    other = tmp_path / "elsewhere.json"
    other.write_text(json.dumps(camera))
    assert_found(only(read_with("csv", path, camera=str(other))), frames)
    path.with_suffix(".json").write_text(json.dumps(camera))
    assert_found(only(read_with("csv", path)), frames)


@pytest.mark.parametrize("heading", [0.0, 90.0, -135.0, 725.0])
def test_headings_are_anticlockwise_from_x(recording, heading):
    path, _ = recording
    path.write_text(f"rgb,depth,x,y,heading\nrgb/0.png,depth/0.png,1.5,-2,{heading}\n")
    describe(path, "camera_height = 1.2\n[camera]\nwidth = 32\nheight = 24\nhfov = 90\n")
    (pose,) = only(read_with("csv", path)).poses
    forward = math.cos(math.radians(heading)), math.sin(math.radians(heading)), 0
    np.testing.assert_allclose(pose[:3, 2], forward, atol=1e-9)
    np.testing.assert_allclose(pose[:3, 1], (0, 0, -1), atol=1e-9)
    np.testing.assert_allclose(pose[:3, 3], (1.5, -2, 1.2))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


def test_quaternions_may_turn_the_axes_of_a_robot(recording):
    path, frames = recording
    robot_in_optical = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    lines = rows(path)[:1]
    for frame, time in zip(frames, TIMES, strict=True):
        values = (*frame.pose[:3, 3], *quaternion(frame.pose[:3, :3] @ robot_in_optical))
        lines.append(f"{frame.rgb},{frame.depth},{','.join(f'{v:.9f}' for v in values)},{time}")
    recordings.write_lines(path, lines)
    describe(path, 'pose_axes = "robot"\n[camera]\nwidth = 32\nheight = 24\nhfov = 90\n')
    assert_found(only(read_with("csv", path)), frames)


def test_rows_of_several_trajectories_are_separated(recording):
    path, frames = recording
    lines = rows(path)
    names = ["b", "a", "b", "a"]
    lines = [lines[0] + ",trajectory"] + [
        f"{line},{name}" for line, name in zip(lines[1:], names, strict=True)
    ]
    recordings.write_lines(path, lines)
    found = read_with("csv", path)
    assert list(found.trajectories) == ["b", "a"]
    assert_found(found.trajectories["b"], frames[::2])
    assert_found(found.trajectories["a"], frames[1::2])
    assert list(read_with("csv", path, trajectories=["a"]).trajectories) == ["a"]


def test_names_that_a_trajectory_cannot_have_are_refused(recording):
    path, _ = recording
    lines = rows(path)
    recordings.write_lines(path, [lines[0] + ",trajectory", lines[1] + ",../up"])
    with refused("trajectory '../up'"):
        read_with("csv", path)


@pytest.mark.parametrize("column", [True, False])
def test_depth_may_be_left_out(recording, column):
    path, frames = recording
    lines = []
    for line in rows(path):
        rgb, _, rest = line.split(",", 2)
        depth = "" if rgb != "rgb" else "depth"
        lines.append(f"{rgb},{depth},{rest}" if column else f"{rgb},{rest}")
    recordings.write_lines(path, lines)
    for frame in frames:
        frame.depth = frame.depth_sha256 = None
    assert_found(only(read_with("csv", path)), frames)


def test_depth_in_some_rows_is_reported_or_refused(recording):
    path, frames = recording
    lines = rows(path)
    without = [line.replace(str(frames[1].depth), "") for line in lines]
    recordings.write_lines(path, without)
    found = read_with("csv", path)
    assert_found(only(found), frames[:1] + frames[2:])
    assert reported(found, "incomplete row") == ["lab.csv:3"]
    recordings.write_lines(path, [line.replace(str(frames[0].depth), "") for line in lines])
    with refused("lab.csv:3", "depth"):
        read_with("csv", path)


@pytest.mark.parametrize("pose", ["nan,0,0,0,0,0,1", "x,0,0,0,0,0,1", "0,0,0,0,0,0,2", "1"])
def test_unusable_poses_are_reported_with_their_line(recording, pose):
    path, frames = recording
    with path.open("a") as file:
        file.write(f"{frames[0].rgb},{frames[0].depth},{pose},7\n")
    found = read_with("csv", path)
    assert_found(only(found), frames)
    assert kinds(found) == {"bad pose": 1}
    assert reported(found, "bad pose") == ["lab.csv:6"]


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("rgb,depth,x,y,heading\n", "no rows"),
        ("rgb;depth;x;y;heading\na;b;1;2;3\n", "separated by semicolons"),
        ("rgb,depth,x,yy,heading\na,b,1,2,3\n", "no column y (has: rgb, depth, x, yy, heading;"),
        ("trajectory,seq,domain,rgb,depth,x,y,heading\n", "`s2r ingest csv` reads"),
        ("rgb,x,y,z,qx,qy,qz\na,1,2,3,0,0,0\n", "no column qw"),
    ],
)
def test_missing_columns_are_named(recording, content, text):
    recording[0].write_text(content)
    with refused("lab.csv", text):
        read_with("csv", recording[0])


CAMERA = "[camera]\nwidth = 32\nheight = 24\n"


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (CAMERA, "camera.fx"),
        (CAMERA + "fx = -1.0\nfy = 1.0\ncx = 1.0\ncy = 1.0\n", "fx"),
        ("distortion = [1, 2, 3]\n" + CAMERA + "hfov = 90\n", "distortion"),
        ('pose_axes = "left"\n' + CAMERA + "hfov = 90\n", "pose_axes"),
        ("up = [0, 0, 0]\n" + CAMERA + "hfov = 90\n", "up"),
        ("depth_scal = 1.0\n" + CAMERA + "hfov = 90\n", "depth_scale"),
        ("name = 'a'\n[bounds]\nx0 = 1\n", "a configuration of `s2r ingest csv`"),
    ],
)
def test_unusable_descriptions_are_refused(recording, text, key):
    describe(recording[0], text)
    with refused("lab.toml", key):
        read_with("csv", recording[0])
