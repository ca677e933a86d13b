import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rtools.datasets.layouts import read
from s2rtools.datasets.recording import ReadOptions
from tests.datasets.helpers import kinds
from tests.datasets.layouts.rooms import HEIGHT, WIDTH, Walk, assert_poses, image, walk, write_png
from tests.support.refusals import refused

MODELS = {
    "SIMPLE_PINHOLE": (0, (20.0, 12.0, 8.0)),
    "PINHOLE": (1, (20.0, 21.0, 12.0, 8.0)),
    "SIMPLE_RADIAL": (2, (20.0, 12.0, 8.0, 0.1)),
    "RADIAL": (3, (20.0, 12.0, 8.0, 0.1, -0.2)),
    "OPENCV": (4, (20.0, 21.0, 12.0, 8.0, 0.1, -0.2, 0.003, 0.004)),
    "OPENCV_FISHEYE": (5, (20.0, 21.0, 12.0, 8.0, 0.1, -0.2, 0.3, 0.4)),
}
DISTORTIONS = {
    "SIMPLE_PINHOLE": (), "PINHOLE": (), "SIMPLE_RADIAL": (0.1, 0.0, 0.0, 0.0),
    "RADIAL": (0.1, -0.2, 0.0, 0.0), "OPENCV": (0.1, -0.2, 0.003, 0.004),
    "OPENCV_FISHEYE": (0.1, -0.2, 0.3, 0.4),
}  # fmt: skip


def world_to_camera(pose: np.ndarray) -> list[float]:
    """Quaternion w, x, y, z and translation."""
    inverse = np.linalg.inv(pose)
    x, y, z, w = Rotation.from_matrix(inverse[:3, :3]).as_quat()
    return [w, x, y, z, *inverse[:3, 3]]


def names(scene: Walk) -> list[str]:
    return [f"frame {row}.png" for row in range(len(scene))]


def write_text(folder: Path, scene: Walk, cameras: dict[int, str], of=lambda row: 1) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# Camera list with one line of data per camera:"]
    for number, model in cameras.items():
        values = " ".join(str(value) for value in MODELS[model][1])
        lines.append(f"{number} {model} {WIDTH} {HEIGHT} {values}")
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n")
    lines = ["# Image list with two lines of data per image:"]
    for row, name in reversed(list(enumerate(names(scene)))):
        values = " ".join(repr(float(value)) for value in world_to_camera(scene.poses[row]))
        lines += [f"{row + 1} {values} {of(row)} {name}", "1.5 2.5 -1 3.0 4.0 17" * (row % 2)]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text("")


def write_binary(folder: Path, scene: Walk, model: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    number, values = MODELS[model]
    content = struct.pack("<Q", 1) + struct.pack("<iiQQ", 1, number, WIDTH, HEIGHT)
    (folder / "cameras.bin").write_bytes(content + struct.pack(f"<{len(values)}d", *values))
    content = struct.pack("<Q", len(scene))
    for row, name in enumerate(names(scene)):
        content += struct.pack("<i7di", row + 1, *world_to_camera(scene.poses[row]), 1)
        content += name.encode() + b"\0" + struct.pack("<Q", row)
        content += row * struct.pack("<ddq", 1.5, 2.5, -1)
    (folder / "images.bin").write_bytes(content)


def write_images(folder: Path, scene: Walk) -> None:
    for name, pixels in zip(names(scene), scene.rgb, strict=True):
        write_png(folder / name, pixels)


@pytest.fixture
def scene() -> Walk:
    return walk(12)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("kind", ["text", "binary"])
def test_poses_and_cameras_are_those_that_were_written(tmp_path, scene, model, kind):
    if kind == "text":
        write_text(tmp_path / "sparse/0", scene, {1: model})
    else:
        write_binary(tmp_path / "sparse/0", scene, model)
    write_images(tmp_path / "images", scene)
    recording = read("colmap", tmp_path)
    assert_poses(recording, scene.poses)
    camera = recording.camera
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert (camera.fx, camera.cx, camera.cy) == (20.0, 12.0, 8.0)
    assert camera.fy == (21.0 if len(MODELS[model][1]) % 4 == 0 and "SIMPLE" not in model else 20.0)
    assert camera.distortion == DISTORTIONS[model]
    assert camera.is_fisheye == (model == "OPENCV_FISHEYE")
    assert not recording.is_metric


def test_a_scale_makes_poses_metric_and_depth_has_the_names_of_images(tmp_path, scene):
    write_binary(tmp_path / "model", scene, "PINHOLE")
    write_images(tmp_path / "photos", scene)
    for name, pixels in zip(names(scene), scene.depth, strict=True):
        write_png(tmp_path / "depth" / name, pixels)
    (tmp_path / "depth" / names(scene)[0]).unlink()
    options = {
        "scale": "3", "images": str(tmp_path / "photos"), "depth": str(tmp_path / "depth"),
        "depth_scale": "0.0002",
    }  # fmt: skip
    recording = read("colmap", tmp_path / "model", ReadOptions(options))
    scaled = scene.poses[1:].copy()
    scaled[:, :3, 3] *= 3
    assert_poses(recording, scaled)
    assert recording.is_metric
    assert recording.depth_scale == 0.0002
    assert kinds(recording) == {"no depth image": 1}
    without = read("colmap", tmp_path / "model", ReadOptions(options | {"depth": "none"}))
    assert len(without.trajectories["model"].frames) == len(scene)
    frame = recording.trajectories["model"].frames[2]
    assert frame.depth is not None
    np.testing.assert_array_equal(image(frame.depth.read()).pixels, scene.depth[3])


def test_several_cameras_are_named_and_one_can_be_chosen(tmp_path, scene):
    cameras = {1: "PINHOLE", 7: "OPENCV", 9: "RADIAL"}
    write_text(tmp_path, scene, cameras, of=lambda row: 7 if row % 3 else 1)
    write_images(tmp_path / "images", scene)
    with pytest.raises(RequestError, match=r"2 cameras \(1: 24x16, fx 20.0, 4 images; 7: .*="):
        read("colmap", tmp_path)
    with pytest.raises(RequestError, match="no images of camera '9'"):
        read("colmap", tmp_path, ReadOptions({"camera_id": "9"}))
    recording = read("colmap", tmp_path, ReadOptions({"camera_id": "1"}))
    assert_poses(recording, scene.poses[::3])
    write_text(tmp_path, scene, {1: "PINHOLE", 2: "PINHOLE"}, of=lambda row: 1 + row % 2)
    assert_poses(read("colmap", tmp_path), scene.poses)  # equal cameras are one


def test_subfolders_are_trajectories(tmp_path, scene):
    write_text(tmp_path, scene, {1: "PINHOLE"})
    path = tmp_path / "images.txt"
    path.write_text(path.read_text().replace("frame 1", "seq/2/frame 1"))
    for name, pixels in zip(names(scene), scene.rgb, strict=True):
        write_png(tmp_path / "images" / name.replace("frame 1", "seq/2/frame 1"), pixels)
    recording = read("colmap", tmp_path)
    assert list(recording.trajectories) == [tmp_path.name, "seq_2"]
    assert_poses(recording, scene.poses[[1, 10, 11]], "seq_2")


def test_bad_images_are_reported_and_the_others_are_read(tmp_path, scene):
    write_binary(tmp_path, scene, "PINHOLE")
    content = bytearray((tmp_path / "images.bin").read_bytes())
    struct.pack_into("<d", content, 8 + 4 + 32, float("nan"))
    struct.pack_into("<d", content, 8 + 64 + 13 + 8 + 4, 3.0)
    (tmp_path / "images.bin").write_bytes(content)
    write_images(tmp_path / "images", scene)
    (tmp_path / "images" / names(scene)[-1]).unlink()
    recording = read("colmap", tmp_path)
    assert kinds(recording) == {"missing image": 1, "bad pose": 2}
    assert_poses(recording, scene.poses[2:-1])


def test_binary_models_that_are_cut_or_declare_more_end_in_one_line(tmp_path, scene):
    write_binary(tmp_path, scene, "PINHOLE")
    write_images(tmp_path / "images", scene)
    whole = (tmp_path / "images.bin").read_bytes()
    declaring = bytearray(whole)
    struct.pack_into("<Q", declaring, 8 + 64 + len(names(scene)[0]) + 1, 1 << 60)
    for content in (b"", whole[:30], whole[:80], whole[:-1], declaring):
        (tmp_path / "images.bin").write_bytes(content)
        with refused("images.bin: it ends before its last entry"):
            read("colmap", tmp_path)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("cameras.txt", "PINHOLE", "FOV", "cameras.txt:2: model FOV is not read"),
        ("cameras.txt", " 8.0", "", "3 parameters; PINHOLE has 4"),
        ("cameras.txt", " 24 ", " many ", "cameras.txt:2: not `id model width"),
        ("cameras.txt", "\n1 ", "\n2 ", "of camera 1, unknown"),
        ("images.txt", "1.5 2.5 -1 3.0 4.0 17\n", "", ": no line of 2D points"),
        ("images.txt", "\n12 ", "\ntwelve ", "images.txt:2: not `id qw"),
        ("images.txt", "frame 3.png", "../../etc/passwd", "without `..`"),
    ],
)
def test_damaged_text_models_end_in_one_line(tmp_path, scene, file, old, new, message):
    write_text(tmp_path, scene, {1: "PINHOLE"})
    write_images(tmp_path / "images", scene)
    text = (tmp_path / file).read_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1))
    with refused(message):
        read("colmap", tmp_path)


def test_folders_that_are_missing_are_named(tmp_path, scene):
    with pytest.raises(RequestError, match=r"no cameras\.txt with images\.txt"):
        read("colmap", tmp_path)
    for model in ("0", "1"):
        write_text(tmp_path / "sparse" / model, scene, {1: "PINHOLE"})
    with pytest.raises(RequestError, match="several models; give the path of one of"):
        read("colmap", tmp_path)
    with pytest.raises(RequestError, match="no folder `images` beside the model"):
        read("colmap", tmp_path / "sparse/0")
    (tmp_path / "images").mkdir()
    with pytest.raises(RequestError, match="none of the model's images; name their folder"):
        read("colmap", tmp_path / "sparse/1")
