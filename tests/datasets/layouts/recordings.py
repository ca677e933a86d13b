"""Write recordings with known poses in the layouts, without code of the readers."""

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

SIZE = (24, 32)
"""(height, width) of the images."""


@dataclass
class Frame:
    """What a reader must find: names, checksums, the pose and the time, NaN where unknown."""

    rgb: str
    rgb_sha256: str
    pose: np.ndarray
    time: float = math.nan
    depth: str | None = None
    depth_sha256: str | None = None


def turn(axis: Sequence[float], angle: float) -> np.ndarray:
    """The rotation matrix about a unit axis."""
    return Rotation.from_rotvec(angle * np.asarray(axis)).as_matrix()


def drive(times: Iterable[float]) -> list[np.ndarray]:
    """Poses of a camera that moves at 0.5 m/s and turns by 0.4 rad/s about a slanted axis."""
    poses = []
    for time in times:
        pose = np.eye(4)
        pose[:3, :3] = turn((0.48, 0.6, 0.64), 0.4 * time + 0.2)
        pose[:3, 3] = 0.5 * time + 1.0, 2.0 - 0.1 * time, 1.2 + 0.05 * time
        poses.append(pose)
    return poses


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """x, y, z, w of a rotation matrix."""
    return Rotation.from_matrix(rotation).as_quat()


def write_rgb(path: Path, number: int, grey: bool = False) -> str:
    """An image that no other number has; its SHA-256."""
    values = np.random.default_rng(number).integers(0, 255, (*SIZE, 3), dtype=np.uint8)
    Image.fromarray(values[..., 0] if grey else values).save(_new(path))
    return sha256(path)


def write_depth(path: Path, number: int, unit: int = 1000) -> str:
    """Depth of 1 to 5 m in `unit` per metre, with holes of 0; its SHA-256."""
    metres = np.random.default_rng(1000 + number).uniform(1, 5, SIZE)
    raw = np.round(metres * unit).astype(np.uint16)
    raw[:2] = 0
    Image.fromarray(raw).save(_new(path))
    return sha256(path)


def write_lines(path: Path, lines: Iterable[str]) -> None:
    _new(path).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def edit(path: Path, change: Callable[[list[str]], object]) -> None:
    """Change the lines of a text file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    change(lines)
    write_lines(path, lines)


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def tum(folder: Path, poses: Sequence[np.ndarray], times: Sequence[float]) -> list[Frame]:
    """Depth images 4 ms after those of RGB, true poses at the times of RGB."""
    frames = []
    rgb, depth, truth = ["# color images"], ["# depth maps"], ["# timestamp tx ty tz qx qy qz qw"]
    for number, (pose, time) in enumerate(zip(poses, times, strict=True)):
        frame = Frame(f"rgb/{time:.6f}.png", "", pose, time, f"depth/{time + 0.004:.6f}.png")
        frame.rgb_sha256 = write_rgb(folder / frame.rgb, number)
        frame.depth_sha256 = write_depth(folder / str(frame.depth), number, 5000)
        rgb.append(f"{time:.6f} {frame.rgb}")
        depth.append(f"{time + 0.004:.6f} {frame.depth}")
        truth.append(f"{time:.6f} {tum_pose(pose)}")
        frames.append(frame)
    write_lines(folder / "rgb.txt", rgb)
    write_lines(folder / "depth.txt", depth)
    write_lines(folder / "groundtruth.txt", truth)
    return frames


def tum_pose(pose: np.ndarray) -> str:
    return " ".join(f"{value:.7f}" for value in (*pose[:3, 3], *quaternion(pose[:3, :3])))


def matrix_text(matrix: np.ndarray) -> list[str]:
    return [" ".join(f"{value:.8e}" for value in row) for row in matrix]


def seven_scenes(folder: Path, poses: Sequence[np.ndarray], sequence: int = 1) -> list[Frame]:
    frames = []
    for number, pose in enumerate(poses):
        stem = f"seq-{sequence:02d}/frame-{number:06d}"
        frame = Frame(f"{stem}.color.png", "", pose, depth=f"{stem}.depth.png")
        frame.rgb_sha256 = write_rgb(folder / frame.rgb, 100 * sequence + number)
        frame.depth_sha256 = write_depth(folder / str(frame.depth), 100 * sequence + number)
        write_lines(folder / f"{stem}.pose.txt", matrix_text(pose))
        frames.append(frame)
    return frames


def scannet(folder: Path, poses: Sequence[np.ndarray]) -> list[Frame]:
    """Colour images as PNG content would not fit `.jpg`: Pillow writes JPEG."""
    frames = []
    for number, pose in enumerate(poses):
        frame = Frame(f"color/{number}.jpg", "", pose, depth=f"depth/{number}.png")
        frame.rgb_sha256 = write_rgb(folder / frame.rgb, number)
        frame.depth_sha256 = write_depth(folder / str(frame.depth), number)
        write_lines(folder / f"pose/{number}.txt", matrix_text(pose))
        frames.append(frame)
    for kind, focal in (("color", 30.0), ("depth", 28.0)):
        matrix = np.eye(4)
        matrix[0, :3] = focal, 0, 15.5
        matrix[1, :3] = 0, focal + 1, 11.5
        write_lines(folder / f"intrinsic/intrinsic_{kind}.txt", matrix_text(matrix))
        write_lines(folder / f"intrinsic/extrinsic_{kind}.txt", matrix_text(np.eye(4)))
    return frames


def camera_in_body() -> np.ndarray:
    """A pose of a camera in the axes of a drone's body."""
    pose = np.eye(4)
    pose[:3, :3] = turn((0.0, 0.6, 0.8), 1.3)
    pose[:3, 3] = 0.1, -0.06, 0.02
    return pose


def euroc(
    folder: Path, poses: Sequence[np.ndarray], stamps: Sequence[int], camera: int = 0
) -> list[Frame]:
    """`poses` are those of the camera; the ground truth holds those of the body."""
    mount = camera_in_body()
    frames = []
    images = ["#timestamp [ns],filename"]
    truth = ["#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], ..."]
    for number, (pose, stamp) in enumerate(zip(poses, stamps, strict=True)):
        frame = Frame(f"mav0/cam{camera}/data/{stamp}.png", "", pose, stamp / 1e9)
        frame.rgb_sha256 = write_rgb(folder / frame.rgb, number, grey=True)
        images.append(f"{stamp},{stamp}.png\r")
        truth.append(f"{stamp},{euroc_pose(pose @ np.linalg.inv(mount))},0,0,0,0,0,0,0,0,0")
        frames.append(frame)
    write_lines(folder / f"mav0/cam{camera}/data.csv", images)
    write_lines(folder / "mav0/state_groundtruth_estimate0/data.csv", truth)
    write_sensor(folder / "mav0/state_groundtruth_estimate0/sensor.yaml", np.eye(4))
    more = [
        "rate_hz: 20",
        f"resolution: [{SIZE[1]}, {SIZE[0]}]",
        "camera_model: pinhole",
        "intrinsics: [30.5, 31.0, 15.2, 11.1] #fu, fv, cu, cv",
        "distortion_model: radial-tangential",
        "distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]",
    ]
    write_sensor(folder / f"mav0/cam{camera}/sensor.yaml", mount, more)
    return frames


def euroc_pose(pose: np.ndarray) -> str:
    x, y, z, w = quaternion(pose[:3, :3])
    return ",".join(f"{value:.7f}" for value in (*pose[:3, 3], w, x, y, z))


def write_sensor(path: Path, pose: np.ndarray, more: Sequence[str] = ()) -> None:
    numbers = ",\n         ".join(", ".join(f"{v:.10f}" for v in row) for row in pose)
    head = ["# General sensor definitions.", "sensor_type: any", "comment: written by a test"]
    matrix = ["T_BS:", "  cols: 4", "  rows: 4", f"  data: [{numbers}]"]
    write_lines(path, [*head, *matrix, *more])


KITTI_FOCAL = 30.0
KITTI_OFFSETS = {0: (0.0, 0.0, 0.0), 1: (-0.54, 0.0, 0.0), 2: (0.06, -0.001, 0.003)}
"""Added to a point in the axes of camera 0, metres: the point in those of the other camera."""


def kitti(
    folder: Path, poses: Sequence[np.ndarray], camera: int = 2, sequence: str = "07"
) -> list[Frame]:
    """`poses` are those of camera 0; the frames have those of `camera`."""
    matrix = np.array([[KITTI_FOCAL, 0, 15.5], [0, KITTI_FOCAL, 11.5], [0, 0, 1]])
    calibration = []
    for number, offset in KITTI_OFFSETS.items():
        values = np.hstack([matrix, (matrix @ np.array(offset))[:, None]])
        calibration.append(f"P{number}: " + " ".join(f"{v:.12e}" for v in values.ravel()))
    calibration.append("Tr: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27")
    inside = folder / "sequences" / sequence
    write_lines(inside / "calib.txt", calibration)
    frames, times = [], []
    for number, pose in enumerate(poses):
        name = f"sequences/{sequence}/image_{camera}/{number:06d}.png"
        mounted = pose.copy()
        mounted[:3, 3] -= pose[:3, :3] @ np.array(KITTI_OFFSETS[camera])
        digest = write_rgb(folder / name, number, grey=camera < 2)
        frames.append(Frame(name, digest, mounted, float(f"{0.1 * number:.6e}")))
        times.append(f"{0.1 * number:.6e}")
    write_lines(inside / "times.txt", times)
    rows = [" ".join(f"{value:.6e}" for value in pose[:3].ravel()) for pose in poses]
    write_lines(folder / "poses" / f"{sequence}.txt", rows)
    return frames


def csv(path: Path, poses: Sequence[np.ndarray], times: Sequence[float]) -> list[Frame]:
    frames = []
    rows = ["rgb,depth,x,y,z,qx,qy,qz,qw,timestamp"]
    for number, (pose, time) in enumerate(zip(poses, times, strict=True)):
        frame = Frame(f"rgb/{number}.png", "", pose, time, f"depth/{number}.png")
        frame.rgb_sha256 = write_rgb(path.parent / frame.rgb, number)
        frame.depth_sha256 = write_depth(path.parent / str(frame.depth), number)
        values = (*pose[:3, 3], *quaternion(pose[:3, :3]))
        numbers = ",".join(f"{value:.9f}" for value in values)
        rows.append(f"{frame.rgb},{frame.depth},{numbers},{time}")
        frames.append(frame)
    write_lines(path, rows)
    camera = f"[camera]\nwidth = {SIZE[1]}\nheight = {SIZE[0]}\nhfov = 90\n"
    path.with_suffix(".toml").write_text(camera)
    return frames


def _new(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
