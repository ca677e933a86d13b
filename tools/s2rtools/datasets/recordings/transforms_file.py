"""Read `transforms.json` of nerfstudio and instant-ngp: its frames, their cameras and poses.

Sources: "Data conventions" of nerfstudio's documentation, instant-ngp's "Tips for training NeRF
models".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.documents import decode_json
from s2rstore.files.input_files import read_bytes
from s2rtools.common.image_files import SUFFIXES
from s2rtools.datasets.files.image_decoding import declared_size
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import PinholeCamera, natural_order

_MAX_BYTES = 256 << 20
"""Bytes of a file; a frame has about 700."""
_LATEST = 1e300
"""Times up to which a frame is sorted by them: finite numbers."""
_DEPTH_UNIT = 1e-3
"""World units per unit of depth where the file states none, as in nerfstudio."""
_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE", "SIMPLE_RADIAL", "RADIAL")
_FISHEYES = ("OPENCV_FISHEYE", "FISHEYE")

Matrix = list[list[float]]


class Intrinsics(msgspec.Struct, frozen=True):
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


class Frame(Intrinsics, kw_only=True, frozen=True):
    """One frame; `transform_matrix` maps OpenGL's axes of the camera to the world."""

    file_path: str
    transform_matrix: Matrix
    depth_file_path: str | None = None
    depth_path: str | None = None
    timestamp: Any = None
    time: Any = None

    @property
    def depth_name(self) -> str | None:
        return self.depth_file_path or self.depth_path


class Transforms(Intrinsics, kw_only=True, frozen=True):
    """A file; `applied_transform` and `applied_scale` were applied to the original world."""

    frames: list[Frame]
    applied_transform: Matrix | None = None
    applied_scale: float | None = None
    depth_unit_scale_factor: float | None = None
    integer_depth_scale: float | None = None

    @property
    def has_depth(self) -> bool:
        return any(frame.depth_name for frame in self.frames)

    @property
    def depth_unit(self) -> float:
        """World units per unit of depth."""
        unit = self.depth_unit_scale_factor or self.integer_depth_scale
        return unit if unit is not None and 0 < unit < math.inf else _DEPTH_UNIT

    def camera(
        self, frame: Frame, image: Path, sizes: dict[Intrinsics, tuple[int, int]], where: str
    ) -> PinholeCamera:
        """The camera of a frame; without `w` and `h`, for the size of its image.

        `sizes` collects (height, width) by the intrinsics: images of equal ones have one size.

        Raises RequestError, beginning with `where`, for intrinsics that are missing or not read.
        """
        values = Intrinsics(
            *(
                getattr(self, name) if getattr(frame, name) is None else getattr(frame, name)
                for name in Intrinsics.__struct_fields__
            )
        )
        width, height = values.w, values.h
        if width is None or height is None:
            if values not in sizes:
                declared = declared_size(image)
                if declared is None:
                    raise RequestError(f"{where}: no w and h, and {image.name} is no image")
                sizes[values] = declared
            height, width = sizes[values]
        if not (float(width).is_integer() and float(height).is_integer()):
            raise RequestError(f"{where}: w and h are whole numbers of pixels")
        fl_x = _focal(width, values.camera_angle_x) if values.fl_x is None else values.fl_x
        fl_y = _focal(height, values.camera_angle_y) if values.fl_y is None else values.fl_y
        fl_x, fl_y = fl_y if fl_x is None else fl_x, fl_x if fl_y is None else fl_y
        if fl_x is None or fl_y is None:
            raise RequestError(f"{where}: no fl_x and no camera_angle_x")
        cx = width / 2 if values.cx is None else values.cx
        cy = height / 2 if values.cy is None else values.cy
        distortion, is_fisheye = _distortion(values, where)
        camera = PinholeCamera(int(width), int(height), fl_x, fl_y, cx, cy, distortion, is_fisheye)
        return camera.checked(where)

    def poses(self, rows: Sequence[int], path: Path) -> NDArray[np.float64]:
        """Poses (N, 4, 4) of frames in the original world; NaN for other matrices.

        Raises RequestError, beginning with `path`, if `applied_transform` is no similarity.
        """
        matrices = [self.frames[row].transform_matrix for row in rows]
        poses = np.full((len(matrices), 4, 4), np.nan)
        for row, matrix in enumerate(matrices):
            if _is_affine(matrix):
                poses[row] = np.vstack([matrix[:3], [0.0, 0.0, 0.0, 1.0]])
        poses[:, :3, 3] /= self.applied_scale or 1.0
        inverse, scale = self._inverse(path)
        poses = inverse @ poses @ _OPENGL_TO_OPENCV
        poses[:, :3, :3] *= scale
        return np.asarray(poses)

    def _inverse(self, path: Path) -> tuple[NDArray[np.float64], float]:
        """The inverse (4, 4) of `applied_transform`, and its scale."""
        if self.applied_transform is None:
            return np.eye(4), 1.0
        refusal = f"{path}: applied_transform must be a rotation, times a scale, with a translation"
        if not _is_affine(self.applied_transform):
            raise RequestError(refusal)
        matrix = np.vstack([self.applied_transform[:3], [0.0, 0.0, 0.0, 1.0]])
        scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
        product = matrix[:3, :3] @ matrix[:3, :3].T
        if not scale > 1e-9 or np.abs(product / scale**2 - np.eye(3)).max() > 1e-3:
            raise RequestError(refusal)
        return np.asarray(np.linalg.inv(matrix)), scale

    def recording_order(self) -> list[int]:
        """The numbers of the frames by time where all of them state it, then by name."""
        frames = self.frames
        by_name = sorted(
            range(len(frames)),
            key=lambda number: natural_order(PurePosixPath(frames[number].file_path).as_posix()),
        )
        for key in ("timestamp", "time"):
            times = [getattr(frame, key) for frame in frames]
            if all(isinstance(time, int | float) and abs(time) < _LATEST for time in times):
                return sorted(by_name, key=lambda number: times[number])
        return by_name


def read_transforms(path: Path) -> Transforms:
    """Raises RequestError unless the file is one of the layout."""
    return decode_json(read_bytes(path, _MAX_BYTES), Transforms, str(path))


def find_image(containment: PathContainment, name: str, where: str) -> Path | None:
    """The image's path; files of the original NeRF data sets are named without their suffix."""
    has_suffix = PurePosixPath(name).suffix.lower() in SUFFIXES
    names = [name] if has_suffix else [name, *(name + suffix for suffix in SUFFIXES)]
    found = (containment.find_file(each, where) for each in names)
    return next((path for path in found if path is not None), None)


def _is_affine(matrix: Matrix) -> bool:
    return len(matrix) in (3, 4) and all(len(row) == 4 for row in matrix)


def _focal(pixels: float, angle: float | None) -> float | None:
    if angle is None or not 0 < angle < math.pi:
        return None
    return pixels / (2 * math.tan(angle / 2))


def _distortion(values: Intrinsics, where: str) -> tuple[tuple[float, ...], bool]:
    """OpenCV's coefficients in its order, empty if all are 0, and whether it is a fisheye lens."""
    model = None if values.camera_model is None else values.camera_model.upper()
    if model is not None and model not in _PINHOLES + _FISHEYES:
        known = ", ".join(_PINHOLES[:3] + _FISHEYES[:1])
        raise RequestError(
            f"{where}: camera_model {values.camera_model!r} is not read (reads {known})"
        )
    k1, k2, k3, k4, p1, p2 = (
        getattr(values, name) or 0.0 for name in ("k1", "k2", "k3", "k4", "p1", "p2")
    )
    if model in _FISHEYES or values.is_fisheye:
        return (k1, k2, k3, k4), True
    if k4:
        raise RequestError(f"{where}: k4 is read for OPENCV_FISHEYE only")
    return ((k1, k2, p1, p2, k3) if any((k1, k2, p1, p2, k3)) else ()), False
