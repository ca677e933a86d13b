"""Recordings as `transforms.json` of nerfstudio and instant-ngp, with the images beside it.

`transform_matrix` maps points from the camera's axes of OpenGL (x right, y up, z backward) to the
world. `applied_transform` and `applied_scale`, which nerfstudio's own tools write, are undone:
poses are those of the original data. A file lists its frames in any order: they are sorted by
`timestamp` or `time` where all frames state it, else by the names of their images. Pixel i covers
[i, i + 1), so that intrinsics need no conversion. Depth images hold whole numbers; times
`depth_unit_scale_factor` (nerfstudio) or `integer_depth_scale` (instant-ngp) they are units of the
world.

Sources: "Data conventions" of nerfstudio's documentation, instant-ngp's "Tips for training NeRF
models".
"""

from __future__ import annotations

import math
import os
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import decode_json, read_bytes
from s2rtools.common.image_files import SUFFIXES
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import declared_size
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.recorded_cameras import CAMERA_ID, choose_camera
from s2rtools.datasets.recordings.recorded_files import FrameFiles
from s2rtools.datasets.recordings.recorded_folders import (
    existing_folder,
    folder_name,
    natural_order,
    require_frames,
    trajectory_name,
)
from s2rtools.datasets.recordings.recorded_poses import orthonormal, report_unusable
from s2rtools.datasets.recordings.stated_cameras import checked
from s2rtools.datasets.scan import choose_trajectories

_MAX_BYTES = 256 << 20
"""Bytes of a file; a frame has about 700."""
_LATEST = 1e300
"""Times up to which a frame is sorted by them: finite numbers."""
_DEPTH_UNIT = 1e-3
"""World units per unit of depth where the file states none, as in nerfstudio."""
_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE", "SIMPLE_RADIAL", "RADIAL")
_FISHEYES = ("OPENCV_FISHEYE", "FISHEYE")


class _Intrinsics(msgspec.Struct):
    """Keys that stand at the file's top for all frames, or in a frame."""

    camera_model: str | None = None
    is_fisheye: bool | None = None
    w: float | None = None
    h: float | None = None
    fl_x: float | None = None
    fl_y: float | None = None
    cx: float | None = None
    cy: float | None = None
    camera_angle_x: float | None = None
    camera_angle_y: float | None = None
    k1: float | None = None
    k2: float | None = None
    k3: float | None = None
    k4: float | None = None
    p1: float | None = None
    p2: float | None = None


class _Frame(_Intrinsics, kw_only=True):
    file_path: str
    transform_matrix: list[list[float]]
    depth_file_path: str | None = None
    depth_path: str | None = None
    timestamp: Any = None
    time: Any = None


class _Document(_Intrinsics, kw_only=True):
    frames: list[_Frame]
    applied_transform: list[list[float]] | None = None
    applied_scale: float | None = None
    depth_unit_scale_factor: float | None = None
    integer_depth_scale: float | None = None


class _Frames:
    """The frames of one file whose images exist, in recording order.

    `numbers` are their rows in the file.
    """

    def __init__(self, path: Path, containment: PathContainment) -> None:
        self.path = path
        self.document = decode_json(read_bytes(path, _MAX_BYTES), _Document, str(path))
        self.numbers: list[int] = []
        self.files = FrameFiles(containment.folder)
        self.cameras: list[PinholeCamera] = []
        self.issues: list[InputIssue] = []
        self.has_depth = any(_depth_name(frame) for frame in self.document.frames)
        sizes: dict[tuple[object, ...], tuple[int, int]] = {}

        def relative(path: Path) -> str:
            return Path(os.path.relpath(path, containment.folder)).as_posix()

        for number in _recording_order(self.document.frames):
            frame = self.document.frames[number]
            where = f"{path}: frame {number + 1}"
            rgb = _find_image(containment, frame.file_path, where)
            if rgb is None:
                self.issues.append(InputIssue("missing image", frame.file_path))
                continue
            depth = None
            if self.has_depth:
                name = _depth_name(frame)
                depth = containment.find_file(name, where) if name else None
                if depth is None:
                    detail = name or "no depth_file_path"
                    self.issues.append(InputIssue("no depth image", frame.file_path, detail))
                    continue
            camera = _camera(_Values(frame, self.document, where), rgb, sizes, where)
            self.numbers.append(number)
            self.files.append(relative(rgb), None if depth is None else relative(depth))
            self.cameras.append(camera)

    def poses(self, scale: float) -> NDArray[np.float64]:
        """Poses (N, 4, 4) of the frames in the original world, times `scale`; NaN if unusable."""
        matrices = [self.document.frames[number].transform_matrix for number in self.numbers]
        poses = np.full((len(matrices), 4, 4), np.nan)
        for row, matrix in enumerate(matrices):
            if len(matrix) in (3, 4) and all(len(line) == 4 for line in matrix):
                poses[row] = np.vstack([matrix[:3], [0.0, 0.0, 0.0, 1.0]])
        poses[:, :3, 3] /= self.document.applied_scale or 1.0
        inverse, applied_scale = _inverse(self.document.applied_transform, self.path)
        poses = inverse @ poses @ _OPENGL_TO_OPENCV
        poses[:, :3, :3] *= applied_scale
        poses[:, :3, 3] *= scale
        return np.asarray(poses)


def read_nerfstudio(path: Path, options: ReadOptions) -> Recording:
    """Read one file, or the folder of `transforms.json` or of several `transforms_*.json`.

    Each of several files is a trajectory. Raises RequestError if a file is missing or damaged, has
    cameras that the option does not choose from, or no usable frame.
    """
    if path.suffix and not path.exists():
        raise RequestError(f"{path}: no such file or folder")
    if path.is_file() and path.suffix.lower() != ".json":
        raise RequestError(f"{path}: not a JSON file; name transforms.json or its folder")
    files = {trajectory_name(path.stem): path} if path.is_file() else _files_in(path)
    root = path.parent if path.is_file() else path
    containment = PathContainment(root, options.allow_outside)
    found = {
        name: _Frames(files[name], containment)
        for name in choose_trajectories(options.trajectories, files, path)
    }
    issues = [issue for frames in found.values() for issue in frames.issues]
    names: dict[PinholeCamera, str] = {}
    images = [
        names.setdefault(camera, str(len(names) + 1))
        for frames in found.values()
        for camera in frames.cameras
    ]
    if not images:
        require_frames("nerfstudio", path, {}, issues)
    by_name = {name: camera for camera, name in names.items()}
    camera, used, remark = choose_camera(by_name, images, options.values.get(CAMERA_ID), path)
    if remark:
        issues.append(InputIssue("several cameras", path.name, remark))
    scale = options.positive("scale", 1.0)
    recording = Recording("nerfstudio", folder_name(root), root, camera, issues=issues)
    recording.is_metric = "scale" in options.values
    recording.scale_option = "scale"
    recording.depth_in_world_units = "depth_scale" not in options.values
    recording.outside_folders = containment.outside_folders
    units = {_depth_unit(frames.document) for frames in found.values() if frames.has_depth}
    if len(units) > 1 and "depth_scale" not in options.values:
        raise RequestError(f"{path}: its files have different units of depth; set depth_scale")
    recording.depth_scale = options.positive("depth_scale", max(units, default=1e-3) * scale)
    for name, frames in found.items():
        rows = [row for row, each in enumerate(frames.cameras) if names[each] in used]
        frames.files.size = camera.height, camera.width
        trajectory = _trajectory(frames, rows, scale, issues)
        if len(trajectory.frames):
            recording.trajectories[name] = trajectory
    require_frames("nerfstudio", path, recording.trajectories, issues)
    recording.provenance = {"cameras": remark or "one", "world_units_to_metres": scale}
    return recording


def _trajectory(
    frames: _Frames, rows: list[int], scale: float, issues: list[InputIssue]
) -> RecordedTrajectory:
    """The frames of the rows that have usable poses; the others are reported."""
    poses = frames.poses(scale)[rows]
    usable = report_unusable(poses, lambda row: frames.files[rows[row]].rgb.name, issues)
    kept = frames.files.chosen(rows[row] for row in np.flatnonzero(usable))
    return RecordedTrajectory(kept, orthonormal(poses[usable]), np.full(len(kept), np.nan))


class _Values:
    """Keys of a frame, or of its file where the frame does not have them."""

    def __init__(self, frame: _Frame, document: _Document, where: str) -> None:
        self._frame, self._document, self._where = frame, document, where

    def number(self, name: str) -> float | None:
        value = getattr(self._frame, name)
        found: float | None = getattr(self._document, name) if value is None else value
        return found

    def is_fisheye(self) -> bool:
        """Whether the camera is a fisheye. Raises RequestError for an unsupported camera model."""
        model = self._frame.camera_model or self._document.camera_model
        if model is not None and model.upper() not in _PINHOLES + _FISHEYES:
            known = ", ".join(_PINHOLES[:3] + _FISHEYES[:1])
            raise RequestError(f"{self._where}: camera_model {model!r} is not read (reads {known})")
        if model is not None and model.upper() in _FISHEYES:
            return True
        return bool(self._frame.is_fisheye or self._document.is_fisheye)

    def distortion(self) -> tuple[float, ...]:
        """OpenCV's coefficients in its order, empty if all are 0."""
        k1, k2, k3, k4, p1, p2 = (
            self.number(name) or 0.0 for name in ("k1", "k2", "k3", "k4", "p1", "p2")
        )
        if self.is_fisheye():
            return k1, k2, k3, k4
        if k4:
            raise RequestError(f"{self._where}: k4 is read for OPENCV_FISHEYE only")
        return (k1, k2, p1, p2, k3) if any((k1, k2, p1, p2, k3)) else ()


def _camera(
    values: _Values, image: Path, sizes: dict[tuple[object, ...], tuple[int, int]], where: str
) -> PinholeCamera:
    """The camera of a frame; `sizes` holds those of images whose size the file does not state."""
    width, height = values.number("w"), values.number("h")
    keys = ("fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
    fl_x, fl_y, cx, cy, angle_x, angle_y = (values.number(key) for key in keys)
    if width is None or height is None:
        key = fl_x, fl_y, cx, cy, angle_x, angle_y
        if key not in sizes:
            declared = declared_size(image)
            if declared is None:
                raise RequestError(f"{where}: no w and h, and {image.name} is no image")
            sizes[key] = declared
        height, width = sizes[key]
    fl_x = _focal(width, angle_x) if fl_x is None else fl_x
    fl_y = _focal(height, angle_y) if fl_y is None else fl_y
    if fl_x is None and fl_y is None:
        raise RequestError(f"{where}: no fl_x and no camera_angle_x")
    fl_x, fl_y = fl_y if fl_x is None else fl_x, fl_x if fl_y is None else fl_y
    assert fl_x is not None
    assert fl_y is not None
    if not (float(width).is_integer() and float(height).is_integer()):
        raise RequestError(f"{where}: w and h are whole numbers of pixels")
    cx, cy = width / 2 if cx is None else cx, height / 2 if cy is None else cy
    camera = PinholeCamera(
        int(width), int(height), fl_x, fl_y, cx, cy, values.distortion(), values.is_fisheye()
    )
    return checked(camera, where)


def _focal(pixels: float, angle: float | None) -> float | None:
    if angle is None or not 0 < angle < math.pi:
        return None
    return pixels / (2 * math.tan(angle / 2))


def _inverse(transform: list[list[float]] | None, path: Path) -> tuple[NDArray[np.float64], float]:
    """The inverse (4, 4) of `applied_transform`, the identity by default, and its scale."""
    if transform is None:
        return np.eye(4), 1.0
    refusal = f"{path}: applied_transform must be a rotation, times a scale, with a translation"
    if len(transform) not in (3, 4) or any(len(row) != 4 for row in transform):
        raise RequestError(refusal)
    matrix = np.vstack([transform[:3], [0.0, 0.0, 0.0, 1.0]])
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    product = matrix[:3, :3] @ matrix[:3, :3].T
    if not scale > 1e-9 or np.abs(product / scale**2 - np.eye(3)).max() > 1e-3:
        raise RequestError(refusal)
    return np.asarray(np.linalg.inv(matrix)), scale


def _recording_order(frames: list[_Frame]) -> list[int]:
    """The numbers of frames by time where all of them state it, then by name."""
    by_name = sorted(
        range(len(frames)),
        key=lambda number: natural_order(PurePosixPath(frames[number].file_path).as_posix()),
    )
    for key in ("timestamp", "time"):
        times = [getattr(frame, key) for frame in frames]
        if all(isinstance(time, int | float) and abs(time) < _LATEST for time in times):
            return sorted(by_name, key=lambda number: times[number])
    return by_name


def _depth_unit(document: _Document) -> float:
    unit = document.depth_unit_scale_factor or document.integer_depth_scale
    return unit if unit is not None and 0 < unit < math.inf else _DEPTH_UNIT


def _depth_name(frame: _Frame) -> str | None:
    return frame.depth_file_path or frame.depth_path


def _find_image(containment: PathContainment, name: str, where: str) -> Path | None:
    """The image's path; files of the original NeRF data sets are named without their suffix."""
    has_suffix = PurePosixPath(name).suffix.lower() in SUFFIXES
    names = [name] if has_suffix else [name, *(name + suffix for suffix in SUFFIXES)]
    found = (containment.find_file(each, where) for each in names)
    return next((path for path in found if path is not None), None)


def _files_in(folder: Path) -> dict[str, Path]:
    if (folder / "transforms.json").is_file():
        return {trajectory_name(folder_name(folder)): folder / "transforms.json"}
    found = sorted(existing_folder(folder).glob("transforms_*.json"))
    if not found:
        raise RequestError(f"{folder}: no transforms.json in it")
    return {trajectory_name(path.stem.removeprefix("transforms_")): path for path in found}


LAYOUT = Layout(
    read_nerfstudio,
    "transforms.json of nerfstudio and instant-ngp",
    {
        "scale": "metres per unit of the world; without it, poses are not metric",
        "depth_scale": "metres per unit of depth, instead of the file's",
        CAMERA_ID: "the camera whose images are read, if there are several, or `median`",
    },
)
