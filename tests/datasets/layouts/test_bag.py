import hashlib
import os
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rtools.common import bag_messages
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.layouts import read
from s2rtools.datasets.recording import ReadOptions, Recording
from tests.datasets.helpers import kinds
from tests.datasets.layouts.bag_writer import (
    CAMERA,
    DEPTH,
    FORMATS,
    INFO,
    RGB,
    CameraBag,
    K,
    Message,
    compressed_depth,
    nanoseconds,
    png,
    walk_bag,
)
from tests.datasets.layouts.rooms import HEIGHT, WIDTH, Walk, assert_poses, image, walk
from tests.support.refusals import refused


@pytest.fixture
def scene() -> Walk:
    return walk(8)


def assert_images(recording: Recording, scene: Walk) -> None:
    (trajectory,) = recording.trajectories.values()
    assert len(trajectory.frames) == len(scene)
    for row in np.random.default_rng(0).permutation(len(scene)).tolist():
        frame = trajectory.frames[row]
        np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[row])
        assert frame.rgb.checksum() == image(frame.rgb.read()).sha256
        assert frame.rgb.pixels == scene.rgb[row][..., 0].size
        assert frame.depth is not None
        np.testing.assert_array_equal(image(frame.depth.read()).pixels, scene.depth[row])


@pytest.mark.parametrize("name", FORMATS)
def test_images_poses_and_intrinsics_are_those_that_were_written(tmp_path, scene, name):
    walk_bag(tmp_path / name, scene).write()
    recording = read("bag", tmp_path / name)
    assert_poses(recording, scene.poses)
    assert_images(recording, scene)
    camera = recording.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (K[0], K[4], K[2] + 0.5, K[5] + 0.5)
    assert camera.distortion == ()
    assert recording.depth_camera is None
    assert recording.depth_scale == 0.001
    assert recording.is_metric
    assert recording.up == (0.0, 0.0, 1.0)
    assert kinds(recording) == {}
    (trajectory,) = recording.trajectories.values()
    np.testing.assert_allclose(trajectory.timestamps, scene.times, atol=1e-6)
    assert trajectory.frames[1].rgb.name == f"{name}:{RGB}:{nanoseconds(scene)[1]}"
    assert recording.provenance[next(iter(recording.trajectories))]["camera_frame"] == CAMERA


def level(x: float, heading: float) -> np.ndarray:
    """The pose of a robot on the floor, z up."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", heading).as_matrix()
    pose[0, 3] = x
    return pose


MOUNT = np.eye(4)
MOUNT[:3, :3] = Rotation.from_euler("zyx", [0.1, 0.2, -0.05]).as_matrix()
MOUNT[:3, 3] = 0.2, 0.01, 0.3
OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def odometry_of(scene: Walk, child: str) -> Message:
    return lambda bag, time, row: bag.odometry("/odom", time, scene.poses[row], child)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_the_file_of_a_ros_2_bag_alone(tmp_path, scene, kind):
    (file,) = walk_bag(tmp_path / f"folder-{kind}", scene).write().glob(f"*.{kind}")
    recording = read("bag", file)
    assert_poses(recording, scene.poses)
    assert_images(recording, scene)
    (file.parent / "metadata.yaml").unlink()
    assert_poses(read("bag", file.parent), scene.poses)


def test_mcap_files_without_an_index(tmp_path, scene):
    """The footer (a byte, its length, two offsets, a checksum) is in front of 8 closing bytes."""
    bag = walk_bag(tmp_path / "folder-mcap", scene)
    bag.items.sort(key=lambda item: item[2])
    (file,) = bag.write().glob("*.mcap")
    content = bytearray(file.read_bytes())
    content[-28:-8] = bytes(20)
    alone = tmp_path / "alone.mcap"
    alone.write_bytes(content)
    recording = read("bag", alone)
    assert_poses(recording, scene.poses)
    assert_images(recording, scene)


def test_what_is_no_bag_ends_in_one_line(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    (tmp_path / "empty.mcap").write_bytes(b"")
    os.mkfifo(tmp_path / "pipe.bag")
    for path, message in (
        (tmp_path / "notes.txt", "cannot be read as a ROS bag"),
        (tmp_path / "empty.mcap", "cannot be read as a ROS bag"),
        (tmp_path / "pipe.bag", "a pipe, not a regular file"),
        (tmp_path / "missing.bag", "no such bag"),
    ):
        with refused(match=message):
            read("bag", path)


@pytest.mark.parametrize(
    ("name", "compression"),
    [
        ("one.bag", "BZ2"), ("one.bag", "LZ4"), ("folder", "FILE"), ("folder", "MESSAGE"),
        ("folder-mcap", "STORAGE"),
    ],
)  # fmt: skip
def test_compressed_bags(tmp_path, scene, name, compression):
    walk_bag(tmp_path / name, scene).write(compression)
    recording = read("bag", tmp_path / name)
    assert_poses(recording, scene.poses)
    assert_images(recording, scene)


@pytest.mark.parametrize("name", FORMATS)
def test_transforms_lead_from_the_world_to_the_cameras_optical_frame(tmp_path, scene, name):
    """The robot moves at 50 Hz between and beside the images' times; map to odom drifts."""
    bag = walk_bag(tmp_path / name, scene, pose=None)
    times = nanoseconds(scene)
    bag.transform("/tf_static", times[0], "base_link", "camera_link", MOUNT)
    bag.transform("/tf_static", times[0], "camera_link", CAMERA, OPTICAL)

    def robot(time: int) -> np.ndarray:
        seconds = (time - times[0]) * 1e-9
        return level(0.5 * seconds, 0.8 * seconds)

    drift = level(3.0, 1.0)
    for time in range(times[0] - 50_000_000, times[-1] + 50_000_000, 20_000_000):
        bag.transform("/tf", time, "odom", "base_link", robot(time + 5_000_000))
        bag.items[-1][3].transforms[0].header.stamp.nanosec += 5_000_000
        bag.transform("/tf", time, "map", "odom", drift)
    bag.write()
    truth = np.array([drift @ robot(time) @ MOUNT @ OPTICAL for time in times])
    recording = read("bag", tmp_path / name)
    assert_poses(recording, truth)
    assert kinds(recording) == {}
    in_odom = read("bag", tmp_path / name, ReadOptions({"world": "odom"}))
    assert_poses(in_odom, np.linalg.inv(drift) @ truth)


def test_odometry_is_moved_from_the_robot_to_the_camera(tmp_path, scene):

    def moved(bag, time, row):
        bag.odometry("/odom", time, level(0.1 * row, 0.05 * row), "base_link")
        bag.transform("/tf_static", time, "base_link", CAMERA, MOUNT @ OPTICAL)

    walk_bag(tmp_path / "one.bag", scene, pose=moved).write()
    recording = read("bag", tmp_path / "one.bag")
    truth = [level(0.1 * row, 0.05 * row) @ MOUNT @ OPTICAL for row in range(len(scene))]
    assert_poses(recording, np.array(truth))
    assert recording.provenance["one"]["pose_frame"] == "base_link"


def test_poses_of_an_unnamed_frame_beside_transforms_are_reported(tmp_path, scene):
    bag = walk_bag(tmp_path / "one.bag", scene)
    bag.transform("/tf_static", nanoseconds(scene)[0], "base_link", CAMERA, MOUNT)
    bag.write()
    assert kinds(read("bag", bag.path)) == {"frame assumed": 1}
    declared = read("bag", bag.path, ReadOptions({"body": "base_link"}))
    assert kinds(declared) == {}
    assert_poses(declared, scene.poses @ MOUNT)


def test_poses_in_several_worlds_are_refused(tmp_path, scene):
    bag = walk_bag(tmp_path / "one.bag", scene)
    bag.pose("/pose", nanoseconds(scene)[-1] + 1000, scene.poses[-1], frame="odom")
    with pytest.raises(RequestError, match="poses of /pose are in frames map, odom"):
        read("bag", bag.write())


def test_transforms_that_do_not_move_the_camera_are_refused(tmp_path, scene):
    def unjoined(bag, time, row):
        bag.transform("/tf_static", time, "base_link", CAMERA, MOUNT)
        bag.transform("/tf", time, "odom", "base_footprint", level(1.0, 0.5))

    bag = walk_bag(tmp_path / "one.bag", scene, pose=unjoined)
    with pytest.raises(RequestError, match="no transform moves frame 'camera_optical_frame'"):
        read("bag", bag.write())
    with pytest.raises(RequestError, match=r"up to 'map' \(has: base_footprint, base_link"):
        read("bag", bag.path, ReadOptions({"world": "map"}))
    with pytest.raises(RequestError, match="axes=left: must be optical or forward"):
        read("bag", bag.path, ReadOptions({"axes": "left"}))


def test_odometry_without_transforms_needs_a_declared_frame(tmp_path, scene):
    bag = walk_bag(tmp_path / "one.bag", scene, pose=odometry_of(scene, "base_link"))
    bag.write()
    with pytest.raises(RequestError, match=r"no transforms from frame 'camera_optical_frame' up"):
        read("bag", tmp_path / "one.bag")
    assert_poses(read("bag", tmp_path / "one.bag", ReadOptions({"body": CAMERA})), scene.poses)


def test_axes_that_look_forward_along_x_are_turned(tmp_path, scene):
    walk_bag(
        tmp_path / "one.bag",
        scene,
        rgb=lambda bag, time, row: bag.image(
            RGB, time, scene.rgb[row], "rgb8", frame="camera_link"
        ),
        depth=None,
        pose=lambda bag, time, row: bag.covariant_pose(
            "/pose", time, scene.poses[row] @ np.linalg.inv(OPTICAL)
        ),
    ).write()
    assumed = read("bag", tmp_path / "one.bag")
    assert kinds(assumed) == {"axes assumed": 1}
    assert assumed.trajectories["one"].frames[0].depth is None
    declared = read("bag", tmp_path / "one.bag", ReadOptions({"axes": "forward"}))
    assert_poses(declared, scene.poses)
    assert kinds(declared) == {}


def colour_of(encoding: str, pixels: np.ndarray) -> np.ndarray:
    """The samples that a camera would record for an RGB image."""
    if encoding in ("bgr8", "8UC3"):
        return pixels[..., ::-1]
    if encoding == "rgba8":
        return np.dstack([pixels, np.full(pixels.shape[:2], 9, np.uint8)])
    if encoding == "rgb16":
        return pixels.astype(np.uint16) << 8
    return pixels


@pytest.mark.parametrize(
    ("encoding", "padding"), [("rgb8", 0), ("bgr8", 5), ("8UC3", 0), ("rgba8", 5), ("rgb16", 5)]
)
def test_encodings_of_colour(tmp_path, scene, encoding, padding):
    def encoded(bag, time, row):
        bag.image(RGB, time, colour_of(encoding, scene.rgb[row]), encoding, padding=padding)

    walk_bag(tmp_path / "one.bag", scene, rgb=encoded, depth=None).write()
    (trajectory,) = read("bag", tmp_path / "one.bag").trajectories.values()
    for frame, pixels in zip(trajectory.frames, scene.rgb, strict=True):
        found = image(frame.rgb.read())
        np.testing.assert_array_equal(found.pixels, pixels)
        assert found.bits == (16 if encoding == "rgb16" else 8)


def test_grey_and_bayer_patterns(tmp_path, scene):
    """A pattern of one colour is that colour everywhere; red is at even rows and columns."""
    mosaic = np.zeros((HEIGHT, WIDTH), np.uint8)
    mosaic[::2, ::2], mosaic[1::2, 1::2] = 200, 30
    mosaic[::2, 1::2] = mosaic[1::2, ::2] = 100
    for name, encoding, pixels, colour in (
        ("a.bag", "bayer_rggb8", mosaic, (200, 100, 30)),
        ("b.bag", "mono8", np.full((HEIGHT, WIDTH), 77, np.uint8), (77, 77, 77)),
    ):
        one = partial(CameraBag.image, topic=RGB, pixels=pixels, encoding=encoding)
        walk_bag(tmp_path / name, walk(1), rgb=lambda b, t, _, one=one: one(b, time=t)).write()
        (trajectory,) = read("bag", tmp_path / name).trajectories.values()
        found = image(trajectory.frames[0].rgb.read()).pixels
        np.testing.assert_array_equal(found[2:-2, 2:-2].reshape(-1, 3).max(axis=0), colour)
        np.testing.assert_array_equal(found[2:-2, 2:-2].reshape(-1, 3).min(axis=0), colour)


def test_depth_in_metres_becomes_millimetres(tmp_path, scene):
    metres = scene.depth.astype(np.float32) / 1000
    metres[:, 0, :6] = np.nan, np.inf, -np.inf, -1.0, 0.0, 70.0
    expected = scene.depth.copy()
    expected[:, 0, :6] = 0
    for name, order in (("a.bag", "<f4"), ("b.bag", ">f4")):

        def in_metres(bag, time, row, order=order):
            big = int(order == ">f4")
            bag.image(DEPTH, time, metres[row].astype(order), "32FC1", is_bigendian=big)

        walk_bag(tmp_path / name, scene, depth=in_metres).write()
        assert_images(
            read("bag", tmp_path / name), Walk(scene.rgb, expected, scene.poses, scene.times)
        )
    with pytest.raises(RequestError, match="is in metres; omit depth_scale"):
        read("bag", tmp_path / "a.bag", ReadOptions({"depth_scale": "0.001"}))


@pytest.mark.parametrize(
    ("name", "form"),
    zip(FORMATS, ("16UC1; compressedDepth png", "32FC1; compressedDepth", "png"), strict=True),
)
def test_compressed_images(tmp_path, scene, name, form):
    """Inverse depth as `compressed_depth_image_transport` writes it: v = a / depth + b."""
    a, b = np.float32(100 * 101), np.float32(1 - 100 * 101 / 10)

    def rgb(bag, time, row):
        bag.compressed(f"{RGB}/compressed", time, png(scene.rgb[row]), "rgb8; png compressed bgr8")

    def depth_image(bag, time, row):
        if form == "png":
            content = png(scene.depth[row])
        elif form.startswith("16UC1"):
            content = compressed_depth(scene.depth[row])
        else:
            inverse = np.rint(a / (scene.depth[row] / 1000) + b).astype(np.uint16)
            inverse[0, 0] = 0
            content = compressed_depth(inverse, a, b)
        bag.compressed(f"{DEPTH}/compressedDepth", time, content, form)

    bag = walk_bag(tmp_path / name, scene, rgb=rgb, depth=depth_image)
    recording = read("bag", bag.write())
    assert_poses(recording, scene.poses)
    (trajectory,) = recording.trajectories.values()
    for row, frame in enumerate(trajectory.frames):
        np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[row])
        assert frame.rgb.checksum() == hashlib.sha256(png(scene.rgb[row])).hexdigest()
        assert frame.depth is not None
        depth = image(frame.depth.read()).pixels
        assert depth.dtype == np.uint16
        if "32FC1" in form:
            assert depth[0, 0] == 0
            step = (scene.depth[row] / 1000.0) ** 2 / a * 1000
            apart = np.abs(depth.astype(float) - scene.depth[row])
            assert (apart <= 0.5 * step + 1)[depth > 0].all()
            assert (depth > 0).sum() == depth.size - 1
        else:
            np.testing.assert_array_equal(depth, scene.depth[row])


def test_depth_that_is_compressed_otherwise_is_reported(tmp_path, scene):
    contents = compressed_depth(scene.depth[0]), bytes(12) + bytes(40)

    def compressed(bag, time, row):
        form = f"16UC1; compressedDepth {('png', 'rvl')[row]}"
        bag.compressed("/depth", time, contents[row], form)

    bag = walk_bag(tmp_path / "one.bag", walk(2), depth=compressed)
    (trajectory,) = read("bag", bag.write()).trajectories.values()
    assert trajectory.frames[1].depth is not None
    issue = trajectory.frames[1].depth.read()
    assert isinstance(issue, InputIssue)
    assert "RVL is not" in issue.detail


def test_camera_info_with_distortion_binning_and_a_region(tmp_path, scene):
    def info(bag, time, row):
        bag.image("/cam/rgb/image_rect", time, scene.rgb[row], "rgb8")
        d = [0.1, -0.2, 0.003, 0.004, 0.05]
        bag.info(INFO, time, d=d, width=2 * WIDTH + 8, height=2 * HEIGHT, binning_x=2, binning_y=2)
        roi = bag.items[-1][3].roi
        roi.x_offset, roi.width, roi.height = 8, 2 * WIDTH, 2 * HEIGHT

    bag = walk_bag(tmp_path / "one.bag", scene, info=info, depth=None)
    bag.write()
    camera = read("bag", bag.path, ReadOptions({"rgb": RGB})).camera
    assert camera.distortion == (0.1, -0.2, 0.003, 0.004, 0.05)
    assert (camera.fx, camera.fy) == (10.0, 10.5)
    assert (camera.cx, camera.cy) == ((11.5 + 0.5 - 8) / 2, 4.0)
    rectified = read("bag", bag.path, ReadOptions({"rgb": "/cam/rgb/image_rect"})).camera
    assert rectified.distortion == ()
    assert (rectified.fx, rectified.fy) == (9.0, 9.5)


def test_fisheye_cameras_and_stated_intrinsics(tmp_path, scene):
    lens = {"d": [0.1, 0.2, 0.3, 0.4], "distortion_model": "equidistant"}
    bag = walk_bag(
        tmp_path / "one.bag", scene, info=lambda b, time, row: b.info(INFO, time, **lens)
    )
    bag.write()
    camera = read("bag", bag.path).camera
    assert camera.is_fisheye
    assert camera.distortion == (0.1, 0.2, 0.3, 0.4)
    stated = read("bag", bag.path, ReadOptions({"camera": "20,21,11.5,7.5"})).camera
    assert (stated.fx, stated.fy, stated.cx, stated.cy) == (20.0, 21.0, 12.0, 8.0)
    assert (stated.width, stated.height) == (WIDTH, HEIGHT)


def test_ambiguous_topics_are_listed_and_options_choose(tmp_path, scene):
    bag = walk_bag(tmp_path / "one.bag", scene)
    for row, time in enumerate(nanoseconds(scene)):
        bag.image("/left/image_raw", time, scene.rgb[row][::-1], "rgb8")
        bag.pose("/slam", time, np.linalg.inv(scene.poses[row]))
        bag.image("/ir/depth", time, scene.depth[row][::-1], "16UC1")
    bag.write()
    for options, message in (
        ({}, r"several topics with RGB images; choose one of /cam/rgb/image_raw, /left/image_raw"),
        ({"rgb": RGB}, r"several topics with depth images; .* \(depth=\)"),
        ({"rgb": RGB, "depth": DEPTH}, r"several topics with poses; choose one of /pose, /slam"),
        ({"rgb": "/none"}, r"no RGB images on rgb=/none \(has: /cam/depth/image_raw, "),
        ({"rgb": RGB, "depth": DEPTH, "pose": "tf"}, r"no poses on pose=tf \(has: /pose, /slam\)"),
    ):
        with pytest.raises(RequestError, match=message):
            read("bag", bag.path, ReadOptions(options))
    chosen = ReadOptions({"rgb": RGB, "depth": DEPTH, "pose": "/pose"})
    assert_poses(read("bag", bag.path, chosen), scene.poses)
    assert_images(read("bag", bag.path, chosen), scene)
    left = ReadOptions({"rgb": "/left/image_raw", "depth": "none", "pose": "/slam"})
    recording = read("bag", bag.path, left)
    found = image(recording.trajectories["one"].frames[0].rgb.read())
    np.testing.assert_array_equal(found.pixels, scene.rgb[0][::-1])


def test_what_a_bag_lacks_is_named(tmp_path, scene):
    time = nanoseconds(scene)[0]
    steps = (
        ("no topic with RGB images", lambda bag: bag.image(RGB, time, scene.rgb[0], "rgb8")),
        ("no topic with CameraInfo; set camera=", lambda bag: bag.info(INFO, time)),
        ("no topic with poses", lambda bag: bag.pose("/pose", time, scene.poses[0])),
    )
    for number, (message, _) in enumerate(steps):
        bag = CameraBag(tmp_path / f"{number}.bag")
        bag.image(DEPTH, time, scene.depth[0], "16UC1")
        for _, add in steps[:number]:
            add(bag)
        with pytest.raises(RequestError, match=message):
            read("bag", bag.write())


def test_stamps_out_of_order_are_sorted_and_reported(tmp_path, scene):
    bag = CameraBag(tmp_path / "one.bag")
    times = nanoseconds(scene)
    for row in (0, 2, 1, 3, 4, 6, 5, 7):
        bag.image(RGB, times[row], scene.rgb[row], "rgb8")
        bag.image(DEPTH, times[row], scene.depth[row], "16UC1")
        bag.info(INFO, times[row])
        bag.pose("/pose", times[row], scene.poses[row])
    bag.image(RGB, times[3], scene.rgb[0], "rgb8")
    for number, (topic, kind, _, message) in enumerate(bag.items):
        bag.items[number] = (topic, kind, times[0] + number * 1000, message)
    recording = read("bag", bag.write())
    assert kinds(recording) == {"unordered stamps": 3, "repeated stamps": 1}
    assert_poses(recording, scene.poses)
    assert_images(recording, scene)


def test_headers_without_stamps_take_the_times_of_the_recording(tmp_path, scene):
    bag = walk_bag(tmp_path / "one.bag", scene, depth=None)
    for number, (topic, kind, recorded, message) in enumerate(bag.items):
        message.header.stamp.sec = message.header.stamp.nanosec = 0
        bag.items[number] = topic, kind, recorded - bag.latency, message
    recording = read("bag", bag.write())
    assert_poses(recording, scene.poses)
    np.testing.assert_allclose(recording.trajectories["one"].timestamps, scene.times, atol=1e-6)
    frame = recording.trajectories["one"].frames[5]
    np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[5])


def test_images_without_pose_or_depth_are_reported(tmp_path, scene):
    """Poses 3 to 5 are not usable; 0.2 s of gap would need pose 4 to be interpolated."""

    def depth(bag, time, row):
        if row != 1:
            bag.image(DEPTH, time + 15_000_000, scene.depth[row], "16UC1")

    def pose(bag, time, row):
        bag.pose("/pose", time, scene.poses[row])
        rotation = bag.items[-1][3].pose.orientation
        if row == 3:
            rotation.x, rotation.y, rotation.z, rotation.w = 0.0, 0.0, 0.0, 0.0
        elif row == 4:
            bag.items[-1][3].pose.position.x = float("nan")
        elif row == 5:
            rotation.w += 0.5

    recording = read("bag", walk_bag(tmp_path / "one.bag", scene, depth=depth, pose=pose).write())
    expected = {"no depth image": 1, "no pose": 3, "bad pose": 1}
    assert kinds(recording) == expected
    (bad,) = [issue for issue in recording.issues if issue.kind == "bad pose"]
    assert bad.detail.startswith("3 of 8, first at 17")
    assert_poses(recording, scene.poses[[0, 2, 6, 7]])
    frame = recording.trajectories["one"].frames[2]
    np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[6])
    assert frame.depth is not None
    np.testing.assert_array_equal(image(frame.depth.read()).pixels, scene.depth[6])


def test_damaged_images_are_reported(tmp_path, scene):
    def rgb(bag, time, row):
        content = png(scene.rgb[row])
        if row == 1:
            content = content[:-40]
        elif row == 2:
            content = b"nothing"
        elif row == 3:
            content = png(scene.rgb[row][:, 1:])
        bag.compressed(RGB, time, content, "png")

    def depth(bag, time, row):
        changes = {4: {"height": 10**6}, 5: {"step": 3}}.get(row, {})
        bag.image(DEPTH, time, scene.depth[row], "16UC1", **changes)

    bag = walk_bag(tmp_path / "one.bag", scene, rgb=rgb, depth=depth)
    (trajectory,) = read("bag", bag.write()).trajectories.values()
    found = [frame.rgb.read() for frame in trajectory.frames]
    assert [each.kind for each in found if isinstance(each, InputIssue)] == [
        "truncated image",
        "unreadable image",
        "wrong size",
    ]
    assert trajectory.frames[2].rgb.pixels == 0
    depths = [frame.depth.read() for frame in trajectory.frames if frame.depth is not None]
    assert [each.kind for each in depths if isinstance(each, InputIssue)] == [
        "wrong size",
        "unreadable image",
    ]


def test_bags_that_change_after_they_were_opened_are_reported(tmp_path, scene):
    path = walk_bag(tmp_path / "folder-mcap", scene).write()
    (trajectory,) = read("bag", path).trajectories.values()
    (data,) = path.glob("*.mcap")
    data.write_bytes(bytes(data.stat().st_size))
    found = [frame.rgb.read() for frame in trajectory.frames]
    assert all(isinstance(each, InputIssue) for each in found[1:])


def test_ros_2_bags_without_definitions_of_types(tmp_path, scene):
    """As recorders before 2023 wrote them."""
    path = walk_bag(tmp_path / "folder", scene).write()
    (data,) = path.glob("*.db3")
    with sqlite3.connect(data) as database:
        for table in ("message_definitions", "schema", "metadata"):
            database.execute(f"DROP TABLE {table}")
        database.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
    recording = read("bag", path)
    assert_poses(recording, scene.poses)
    assert_images(recording, scene)


def test_a_folder_of_bags_has_a_trajectory_for_each(tmp_path, scene):
    walk_bag(tmp_path / "first.bag", scene).write()
    walk_bag(tmp_path / "second", walk(5, seed=2)).write()
    (tmp_path / "notes.txt").write_text("nothing")
    recording = read("bag", tmp_path)
    assert list(recording.trajectories) == ["first", "second"]
    assert recording.has_one_world  # of frame map
    assert_poses(recording, walk(5, seed=2).poses, "second")
    only = read("bag", tmp_path, ReadOptions(trajectories=("second",)))
    assert list(only.trajectories) == ["second"]


def test_bags_with_odometry_have_worlds_of_their_own(tmp_path, scene):
    for name in ("first", "second"):
        walk_bag(tmp_path / f"{name}.bag", scene, pose=odometry_of(scene, CAMERA)).write()
    assert not read("bag", tmp_path).has_one_world
    assert read("bag", tmp_path / "first.bag").has_one_world


def test_images_are_read_from_several_threads(tmp_path, scene):
    walk_bag(tmp_path / "folder", scene).write()
    (trajectory,) = read("bag", tmp_path / "folder").trajectories.values()
    frames = [trajectory.frames[row] for row in (7, 1, 5, 0, 3, 2, 6, 4) * 3]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda frame: image(frame.rgb.read()).pixels, frames))
    expected = [scene.rgb[row] for row in (7, 1, 5, 0, 3, 2, 6, 4) * 3]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", FORMATS)
def test_images_are_found_in_any_order_with_little_memory(tmp_path, name, monkeypatch):
    """RGB and depth recorded at one time, and no more than two images kept."""
    scene = walk(24)
    monkeypatch.setattr(bag_messages, "_RECENT_BYTES", 2 * scene.rgb[0].nbytes)
    monkeypatch.setattr(bag_messages, "_AHEAD", 300_000_000)
    bag = walk_bag(
        tmp_path / name,
        scene,
        depth=lambda bag, time, row: bag.image(DEPTH, time, scene.depth[row], "16UC1"),
    )
    (trajectory,) = read("bag", bag.write()).trajectories.values()
    rows = [*range(24), *range(23, -1, -1), 0, 2, 1, 5, 4, 20, 3]
    for row in rows:
        frame = trajectory.frames[row]
        assert frame.depth is not None
        np.testing.assert_array_equal(image(frame.depth.read()).pixels, scene.depth[row])
        np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[row])


def listed_with(path: Path, topic: str, kind: str, is_added: bool) -> None:
    """State another type of a topic in `metadata.yaml`, in place of its own or in front of it."""
    yaml = YAML()
    document = yaml.load(path / "metadata.yaml")
    topics = document["rosbag2_bagfile_information"]["topics_with_message_count"]
    (place,) = (n for n, each in enumerate(topics) if each["topic_metadata"]["name"] == topic)
    if is_added:
        topics.insert(place, deepcopy(topics[place]))
    topics[place]["topic_metadata"]["type"] = kind
    yaml.dump(document, path / "metadata.yaml")


@pytest.mark.parametrize(
    ("topic", "kind", "is_added"),
    [("/pose", "nav_msgs/msg/Odometry", False), ("/pose", "tf2_msgs/msg/TFMessage", True),
     (INFO, "sensor_msgs/msg/CompressedImage", True),
     (RGB, "sensor_msgs/msg/CompressedImage", False)],
)  # fmt: skip
def test_a_topic_that_is_listed_with_another_type_ends_in_one_line(tmp_path, topic, kind, is_added):
    path = walk_bag(tmp_path / "folder", walk(2)).write()
    listed_with(path, topic, kind, is_added)
    reason = "listed with types|cannot be read as" if is_added else "declared type|no topic with"
    with refused(match=f"folder.*({reason})"):
        read("bag", path)


def test_a_damaged_schema_of_a_database_ends_in_one_line(tmp_path, scene):
    """SQLite quotes the damaged text, which is not UTF-8."""
    path = walk_bag(tmp_path / "folder", scene).write()
    (file,) = path.glob("*.db3")
    content = file.read_bytes()
    assert b"name TEXT NOT NULL" in content
    file.write_bytes(content.replace(b"name TEXT NOT NULL", b"name TEXT NOT \x88ULL"))
    with refused("cannot be read as a ROS bag"):
        read("bag", path)
