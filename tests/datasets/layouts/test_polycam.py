import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.datasets.layouts import recordings
from tests.datasets.layouts.checks import assert_found, only, read_with, reported
from tests.datasets.layouts.recordings import SIZE, Frame, drive
from tests.support.refusals import refused

POSES = drive(0.1 * k for k in range(4))


def camera_file(pose: np.ndarray, fx: float = 30.0) -> str:
    """A camera's file; its axes are x right, y up, z backward."""
    turned = pose * [1, -1, -1, 1]
    values = {f"t_{row}{column}": turned[row, column] for row in range(3) for column in range(4)}
    size = {"width": SIZE[1], "height": SIZE[0], "blur_score": 100.0, "timestamp": 1}
    return json.dumps(values | size | {"fx": fx, "fy": 31.0, "cx": 16.5, "cy": 11.5})


def write(folder: Path, poses: list[np.ndarray], prefix: str = "corrected_") -> list[Frame]:
    frames = []
    for number, pose in enumerate(poses):
        stem = f"{5_000_000 + 100_000 * number}"
        rgb, depth = f"keyframes/{prefix}images/{stem}.png", f"keyframes/depth/{stem}.png"
        frame = Frame(rgb, "", pose, 5 + 0.1 * number, depth)
        frame.rgb_sha256 = recordings.write_rgb(folder / rgb, number + 10 * len(prefix))
        frame.depth_sha256 = recordings.write_depth(folder / depth, number)
        cameras = folder / f"keyframes/{prefix}cameras"
        cameras.mkdir(parents=True, exist_ok=True)
        (cameras / f"{stem}.json").write_text(camera_file(pose, 30.0 + 0.1 * number))
        frames.append(frame)
    return frames


def test_optimised_poses_are_preferred_and_the_camera_is_the_median(tmp_path):
    arkit, frames = write(tmp_path, POSES[::-1], ""), write(tmp_path, POSES)
    found = read_with("polycam", tmp_path)
    assert_found(only(found), frames)
    camera = found.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (pytest.approx(30.15), 31, 16.5, 11.5)
    assert found.up == (0, 1, 0)
    assert found.depth_scale == 0.001
    assert "median of 4 cameras" in found.provenance["cameras"]
    assert_found(only(read_with("polycam", tmp_path, poses="arkit")), arkit)
    assert_found(only(read_with("polycam", tmp_path, camera_id="2")), frames[1:2])
    with refused("poses=best"):
        read_with("polycam", tmp_path, poses="best")


def test_the_depth_camera_is_scaled_to_its_images(tmp_path):
    for frame in write(tmp_path, POSES):
        Image.new("I;16", (16, 12)).save(tmp_path / str(frame.depth))
    depth = read_with("polycam", tmp_path).depth_camera
    assert (depth.width, depth.height, depth.fy, depth.cx) == (16, 12, 15.5, 8.25)


def test_without_the_folder_of_depth_colour_images_are_read(tmp_path):
    frames = write(tmp_path, POSES)
    (tmp_path / str(frames[1].depth)).unlink()
    (tmp_path / "keyframes/corrected_cameras/5000000.json").write_text("{}")
    found = read_with("polycam", tmp_path)
    assert_found(only(found), frames[2:])
    assert reported(found, "no depth image") == [frames[1].rgb]
    assert reported(found, "no pose") == [frames[0].rgb]
    for frame in frames:
        (tmp_path / str(frame.depth)).unlink(missing_ok=True)
        frame.depth = frame.depth_sha256 = None
    with refused("option depth=none reads the colour images alone"):
        read_with("polycam", tmp_path)
    assert_found(only(read_with("polycam", tmp_path, depth="none")), frames[1:])
    (tmp_path / "keyframes/depth").rmdir()
    assert_found(only(read_with("polycam", tmp_path)), frames[1:])


def test_another_folder_is_refused(tmp_path):
    with refused("keyframes/images", "cannot be read"):
        read_with("polycam", tmp_path)
