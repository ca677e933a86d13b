"""The camera of a recording whose poses are in a CSV file: its TOML or JSON file, and its poses.

    [camera]                    width, height; hfov, or fx, fy, cx, cy
    [depth_camera]              the same, of depth images (default: those of RGB)
    distortion = []             coefficients of OpenCV, of `cv2.fisheye` with fisheye = true
    depth_scale = 0.001         metres per unit of depth
    depth_raw_max = 65534       largest valid value; 0 is never valid
    pose_axes = "optical"       axes of the camera that a quaternion turns: x right, y down, z
                                forward; "robot": x forward, y left, z up
    up = [0, 0, 1]              direction against gravity in the world, or [] if it is not known
    metric = true               false: the scale of the world is not known
    camera_height = 0.0         z of the camera, metres, where rows have headings

Intrinsics are in pixels of the images, pixel i covers [i, i + 1); hfov in degrees.

Poses are x, y, z, qx, qy, qz, qw, or x, y, heading on the floor, in metres and degrees.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct, field
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.documents import read_document
from s2rtools.common.tables.csv_rows import missing_column, parse_float, read_rows
from s2rtools.common.typed_documents import convert
from s2rtools.datasets.dataset_config import (
    CameraTable,
    Coordinate,
    FieldOfViewCamera,
    IntrinsicsCamera,
    Positive,
)
from s2rtools.datasets.recording import PinholeCamera, Recording
from s2rtools.datasets.recordings.recorded_poses import (
    in_optical_axes,
    level_poses,
    poses_from_quaternions,
)

_QUATERNION = ("qx", "qy", "qz", "qw")
_FULL = ("x", "y", "z", *_QUATERNION)
_ON_FLOOR = ("x", "y", "heading")
POSE_COLUMNS = tuple(dict.fromkeys((*_FULL, *_ON_FLOOR)))


class CameraDescription(Struct, forbid_unknown_fields=True):
    """The keys of the file."""

    camera: dict[str, Any]
    depth_camera: dict[str, Any] | None = None
    distortion: list[float] = []
    fisheye: bool = False
    depth_scale: Positive = 0.001
    depth_raw_max: Annotated[int, Meta(ge=1, le=65535)] = 65534
    pose_axes: Literal["optical", "robot"] = "optical"
    up: Annotated[list[float], Meta(max_length=3)] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    metric: bool = True
    camera_height: Coordinate = 0.0

    def __post_init__(self) -> None:
        if len(self.up) not in (0, 3) or (self.up and math.hypot(*self.up) < 1e-6):
            raise ValueError("up must be a direction of 3 numbers, or []")

    def poses(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Camera poses (N, 4, 4) of rows x, y, heading (degrees) or x, y, z, qx, qy, qz, qw."""
        if values.shape[1] == 3:
            return level_poses(values * (1, 1, math.pi / 180), self.camera_height)
        poses = poses_from_quaternions(values[:, :3], values[:, 3:])
        return in_optical_axes(poses) if self.pose_axes == "robot" else poses


def needed_columns(path: Path, names: Collection[str], first: str) -> Sequence[str]:
    """The needed ones of the columns `names` of a file: `first`, and those of its poses.

    Raises RequestError if one of them is missing.
    """
    poses = _FULL if any(name in names for name in _QUATERNION) else _ON_FLOOR
    for name in (first, *poses):
        if name not in names:
            needed = "; or ".join(", ".join((first, *each)) for each in (_FULL, _ON_FLOOR))
            raise missing_column(path, name, names, needed)
    return (first, *poses)


def describe_cameras(recording: Recording, stated: str | None, csv: Path) -> CameraDescription:
    """Set what the file states of a recording: `stated`, by default that with the name of `csv`.

    Raises RequestError if it is missing or malformed.
    """
    path = Path(stated) if stated else _beside(csv, recording)
    document = read_document(path)
    if isinstance(document, dict) and {"bounds", "domains"} & document.keys():
        raise RequestError(
            f"{path}: a configuration of `s2r ingest csv` (bounds, domains); layout csv takes a "
            "file with a table [camera], which --sim-option or --real-option camera=FILE may name"
        )
    table = convert(document, CameraDescription, str(path))
    recording.camera = _camera(table, table.camera, "camera", path)
    if table.depth_camera is not None:
        recording.depth_camera = _camera(table, table.depth_camera, "depth_camera", path)
    recording.depth_scale, recording.depth_raw_max = table.depth_scale, table.depth_raw_max
    recording.up = (table.up[0], table.up[1], table.up[2]) if table.up else None
    recording.is_metric = table.metric
    recording.provenance = {"camera": path.name, "pose_axes": table.pose_axes}
    return table


def _beside(csv: Path, recording: Recording) -> Path:
    for suffix in (".toml", ".json"):
        beside = csv.with_suffix(suffix)
        if beside.is_file():
            return recording.containment.check(beside, str(csv))
    raise RequestError(
        f"{csv.with_suffix('.toml')}: missing; it describes the camera, unless --sim-option or "
        "--real-option camera=FILE names another file"
    )


def _camera(
    table: CameraDescription, stated: dict[str, Any], key: str, path: Path
) -> PinholeCamera:
    kind: type[CameraTable] = FieldOfViewCamera if "hfov" in stated else IntrinsicsCamera
    camera = convert(stated, kind, str(path), key=key)
    is_rgb = key == "camera"
    distortion = tuple(table.distortion) if is_rgb else ()
    return camera.pinhole(distortion, table.fisheye and is_rgb).checked(f"{path}: {key}")


def timed_poses(
    recording: Recording, csv: Path, description: CameraDescription
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (K,), ascending, and camera poses (K, 4, 4) of a CSV file.

    Reports rows that are not finite. Raises RequestError for fewer than two poses, and where times
    do not ascend.
    """
    columns: list[str] = []
    table: list[list[float]] = []
    for line, row in read_rows(
        csv, ("timestamp", *POSE_COLUMNS),
        lambda names: columns.extend(needed_columns(csv, names, "timestamp")),
    ):  # fmt: skip
        pose = [parse_float(row[name]) for name in columns]
        if np.isfinite(pose).all():
            table.append(pose)
        else:
            recording.report("bad pose", f"{csv.name}:{line}", "not finite")
    if len(table) < 2:
        raise RequestError(f"{csv}: {len(table)} poses; at least two are needed")
    values = np.array(table, dtype=np.float64)
    if np.any(np.diff(values[:, 0]) <= 0):
        raise RequestError(f"{csv}: times are not ascending")
    return values[:, 0], description.poses(values[:, 1:])
