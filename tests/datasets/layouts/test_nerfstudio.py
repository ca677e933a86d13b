import json
import math
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.layouts import read
from s2rtools.datasets.recording import ReadOptions
from tests.datasets.helpers import kinds
from tests.datasets.layouts.recordings import sha256
from tests.datasets.layouts.rooms import HEIGHT, WIDTH, Walk, assert_poses, image, walk, write_png
from tests.support.refusals import refused

SHARED = {"w": WIDTH, "h": HEIGHT, "fl_x": 20.0, "fl_y": 21.0, "cx": 12.5, "cy": 7.5}


def opengl(poses: np.ndarray) -> np.ndarray:
    """The same cameras with axes x right, y up, z backward."""
    turned = poses.copy()
    turned[:, :3, 1:3] *= -1
    return turned


def write(folder: Path, scene: Walk, depth: bool = True, name: str = "transforms.json", **keys):
    frames = []
    for row, matrix in enumerate(opengl(scene.poses)):
        write_png(folder / f"images/{row:03}.png", scene.rgb[row])
        frame = {"file_path": f"./images/{row:03}.png", "transform_matrix": matrix.tolist()}
        if depth:
            write_png(folder / f"depth/{row:03}.png", scene.depth[row])
            frame["depth_file_path"] = f"depth/{row:03}.png"
        frames.append(frame)
    document = {**SHARED, "frames": frames} | keys
    (folder / name).write_text(json.dumps(document))
    return document


def rewrite(folder: Path, document: dict) -> None:
    (folder / "transforms.json").write_text(json.dumps(document))


def test_poses_images_and_intrinsics_are_those_that_were_written(tmp_path):
    scene = walk()
    write(tmp_path, scene, depth_unit_scale_factor=0.002)
    recording = read("nerfstudio", tmp_path)
    (trajectory,) = recording.trajectories.values()
    assert_poses(recording, scene.poses)
    assert np.isnan(trajectory.timestamps).all()
    camera = recording.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (20.0, 21.0, 12.5, 7.5)
    assert camera.distortion == ()
    assert recording.depth_scale == 0.002
    assert not recording.is_metric
    for row, frame in enumerate(trajectory.frames):
        np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[row])
        assert frame.rgb.checksum() == sha256(tmp_path / f"images/{row:03}.png")
        assert frame.depth is not None
        np.testing.assert_array_equal(image(frame.depth.read()).pixels, scene.depth[row])
    assert trajectory.frames[2].rgb.name == "images/002.png"


def test_a_scale_makes_poses_and_depth_metric(tmp_path):
    scene = walk()
    write(tmp_path, scene, integer_depth_scale=0.001)
    recording = read("nerfstudio", tmp_path / "transforms.json", ReadOptions({"scale": "2.5"}))
    scaled = scene.poses.copy()
    scaled[:, :3, 3] *= 2.5
    assert_poses(recording, scaled)
    assert recording.is_metric
    assert recording.depth_scale == pytest.approx(0.0025)


def test_depth_follows_the_scale_of_the_world_unless_its_unit_is_stated(tmp_path):
    write(tmp_path, walk(), depth_unit_scale_factor=0.002)
    recording = read("nerfstudio", tmp_path)
    assert recording.metres_of_depth(2.0) == pytest.approx(0.004)
    assert recording.scale_option == "scale"
    stated = read("nerfstudio", tmp_path, ReadOptions({"depth_scale": "0.005"}))
    assert stated.metres_of_depth(2.0) == pytest.approx(0.005)


def test_applied_transform_and_scale_are_undone(tmp_path):
    scene = walk()
    applied = np.eye(4)
    applied[:3, :3] = Rotation.from_rotvec([0.5, 1.0, -0.3]).as_matrix()
    applied[:3, 3] = 3.0, -1.0, 0.5
    moved = applied @ scene.poses
    moved[:, :3, 3] *= 0.25
    shown = Walk(scene.rgb, scene.depth, moved, scene.times)
    write(tmp_path, shown, applied_transform=applied[:3].tolist(), applied_scale=0.25)
    assert_poses(read("nerfstudio", tmp_path), scene.poses)


def test_an_angle_and_names_without_suffix_as_in_the_original_nerf_data(tmp_path):
    scene = walk()
    document = write(tmp_path, scene, depth=False)
    for frame in document["frames"]:
        frame["file_path"] = frame["file_path"].removesuffix(".png")
    document = {"camera_angle_x": 1.0, "frames": document["frames"]}
    (tmp_path / "transforms.json").unlink()
    for name in ("train", "val"):
        (tmp_path / f"transforms_{name}.json").write_text(json.dumps(document))
    recording = read("nerfstudio", tmp_path)
    assert list(recording.trajectories) == ["train", "val"]
    assert recording.camera.fx == pytest.approx(WIDTH / 2 / math.tan(0.5))
    assert recording.camera.cx == WIDTH / 2
    assert recording.trajectories["val"].frames[0].depth is None
    chosen = read("nerfstudio", tmp_path, ReadOptions(trajectories=("val",)))
    assert list(chosen.trajectories) == ["val"]
    lost = {**document, "frames": [{**document["frames"][0], "file_path": "lost"}]}
    (tmp_path / "transforms_val.json").write_text(json.dumps(lost))
    assert kinds(read("nerfstudio", tmp_path)) == {"missing image": 1, "empty trajectory": 1}


def test_distortion_is_in_the_order_of_opencv(tmp_path):
    write(tmp_path, walk(), k1=0.1, k2=-0.02, p1=0.003, p2=-0.004)
    assert read("nerfstudio", tmp_path).camera.distortion == (0.1, -0.02, 0.003, -0.004, 0.0)
    coefficients = {"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4}
    write(tmp_path, walk(), camera_model="OPENCV_FISHEYE", **coefficients)
    camera = read("nerfstudio", tmp_path).camera
    assert camera.is_fisheye
    assert camera.distortion == (0.1, 0.2, 0.3, 0.4)


def test_several_cameras_are_listed_and_one_or_their_median_can_be_chosen(tmp_path):
    scene = walk()
    document = write(tmp_path, scene)
    for row, frame in enumerate(document["frames"]):
        frame["fl_x"] = 20.0 + (row % 3)
    rewrite(tmp_path, document)
    with pytest.raises(
        RequestError, match=r"3 cameras \(1: 24x16, fx 20.0, 2 images; .*camera_id="
    ):
        read("nerfstudio", tmp_path)
    second = read("nerfstudio", tmp_path, ReadOptions({"camera_id": "2"}))
    assert second.camera.fx == 21.0
    assert_poses(second, scene.poses[1::3])
    median = read("nerfstudio", tmp_path, ReadOptions({"camera_id": "median"}))
    assert median.camera.fx == 21.0
    assert len(median.trajectories[tmp_path.name].frames) == len(scene)
    assert kinds(median) == {"several cameras": 1}


def test_bad_frames_are_reported_and_the_others_are_read(tmp_path):
    scene = walk()
    document = write(tmp_path, scene)
    (tmp_path / "images/000.png").unlink()
    del document["frames"][1]["depth_file_path"]
    document["frames"][2]["transform_matrix"][0][0] += 0.5
    document["frames"][3]["transform_matrix"] = [[1.0, 0.0]]
    rewrite(tmp_path, document)
    write_png(tmp_path / "images/004.png", np.zeros((HEIGHT, WIDTH + 1, 3), np.uint8))
    recording = read("nerfstudio", tmp_path)
    assert kinds(recording) == {"missing image": 1, "no depth image": 1, "bad pose": 2}
    assert_poses(recording, scene.poses[4:])
    (trajectory,) = recording.trajectories.values()
    other = trajectory.frames[0].rgb.read()
    assert isinstance(other, InputIssue)
    assert other.kind == "wrong size"


def test_frames_without_their_depth_images_are_read_by_an_option(tmp_path):
    scene = walk()
    write(tmp_path, scene)
    shutil.rmtree(tmp_path / "depth")
    with refused("option depth=none reads the colour images alone"):
        read("nerfstudio", tmp_path)
    recording = read("nerfstudio", tmp_path, ReadOptions({"depth": "none"}))
    assert_poses(recording, scene.poses)
    assert kinds(recording) == {}


@pytest.mark.parametrize("key", ["file_path", "depth_file_path"])
@pytest.mark.parametrize("name", ["a" * 100_000, "a\0b.png", ""], ids=["long", "nul", "empty"])
def test_a_frame_with_a_name_that_no_file_can_have_is_left_out(tmp_path, key, name):
    scene = walk()
    document = write(tmp_path, scene)
    document["frames"][0][key] = name
    rewrite(tmp_path, document)
    recording = read("nerfstudio", tmp_path)
    assert kinds(recording) == {"missing image" if key == "file_path" else "no depth image": 1}
    assert recording.issues[0].file
    assert_poses(recording, scene.poses[1:])


def test_the_orientation_that_a_photo_states_is_ignored(tmp_path):
    """Intrinsics are those of the stored pixels; orientation 3 would turn them by 180 degrees."""
    write(tmp_path, walk(), depth=False)
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    pixels[:8] = 255
    jpeg = cv2.imencode(".jpg", pixels)[1].tobytes()
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x03\0\0\0\0\0\0"
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    (tmp_path / "images/000.png").write_bytes(jpeg[:2] + segment + jpeg[2:])
    (trajectory,) = read("nerfstudio", tmp_path).trajectories.values()
    found = image(trajectory.frames[0].rgb.read()).pixels
    assert found[0].mean() > 250
    assert found[-1].mean() < 5


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"frames": 3}, "frames"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model 'EQUIRECTANGULAR' is not read"),
        ({"fl_x": -1.0}, "fx is -1; expected 0 < fx"),
        ({"fl_x": None, "fl_y": None}, "no fl_x and no camera_angle_x"),
        ({"k4": 0.1}, "k4 is read for OPENCV_FISHEYE only"),
        ({"w": 1e6, "h": 1e6}, "pixels; at most"),
        ({"applied_transform": [[0.0] * 4] * 3}, "applied_transform must be a rotation"),
        ({"frames": []}, "no usable image of layout nerfstudio"),
    ],
)
def test_what_cannot_be_read_ends_in_one_line(tmp_path, keys, message):
    write(tmp_path, walk(), **keys)
    with refused(match=message):
        read("nerfstudio", tmp_path)


def test_a_path_of_another_kind_is_named(tmp_path):
    (tmp_path / "p.csv").write_text("rgb,x\n")
    with pytest.raises(RequestError, match=r"p\.csv: not a JSON file; name transforms\.json"):
        read("nerfstudio", tmp_path / "p.csv")
    with pytest.raises(RequestError, match=r"nope\.json: no such file"):
        read("nerfstudio", tmp_path / "nope.json")


def test_files_outside_of_the_folder_are_refused(tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    document = write(folder, walk())
    write_png(tmp_path / "secret.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    document["frames"][0]["file_path"] = "../secret.png"
    rewrite(folder, document)
    with pytest.raises(RequestError, match=r"without `\.\.`; --allow-outside"):
        read("nerfstudio", folder)
    recording = read("nerfstudio", folder, ReadOptions(allow_outside=True))
    assert recording.outside_folders == {str(tmp_path.resolve()): 1}
    assert recording.trajectories["scene"].frames[0].rgb.name == "../secret.png"


def test_frames_are_in_recording_order_whatever_their_order_in_the_file(tmp_path):
    scene = walk(12)
    document = write(tmp_path, scene, depth=False)
    for row, frame in enumerate(document["frames"]):
        (tmp_path / f"images/{row:03}.png").rename(tmp_path / f"images/frame_{row}.png")
        frame["file_path"] = f"images/frame_{row}.png"
    frames = document["frames"]
    document["frames"] = [frames[row] for row in (7, 2, 10, 0, 11, 5, 1, 9, 3, 8, 4, 6)]
    rewrite(tmp_path, document)
    recording = read("nerfstudio", tmp_path)
    (trajectory,) = recording.trajectories.values()
    names = [f"images/frame_{row}.png" for row in range(12)]
    assert [frame.rgb.name for frame in trajectory.frames] == names
    assert_poses(recording, scene.poses)
    np.testing.assert_array_equal(image(trajectory.frames[3].rgb.read()).pixels, scene.rgb[3])


@pytest.mark.parametrize("key", ["timestamp", "time"])
def test_times_decide_on_the_order_where_all_frames_state_one(tmp_path, key):
    scene = walk(4)
    document = write(tmp_path, scene, depth=False)
    for frame, time in zip(document["frames"], (0.5, 0.0, 1.0, 0.25), strict=True):
        frame[key] = time
    rewrite(tmp_path, document)
    assert_poses(read("nerfstudio", tmp_path), scene.poses[[1, 3, 0, 2]])
    del document["frames"][2][key]
    rewrite(tmp_path, document)
    assert_poses(read("nerfstudio", tmp_path), scene.poses)
