"""One side of a data set as a CSV file: images and poses of anybody's recording.

    rgb,depth,x,y,z,qx,qy,qz,qw[,timestamp][,trajectory]       6-DoF poses, or
    rgb,depth,x,y,heading[,timestamp][,trajectory]             poses on the floor

`rgb` and `depth` are files relative to the CSV file and inside its folder; the column `depth` may
be left out or empty in all rows. x, y and z in metres, time in seconds. Quaternions turn the
camera's axes into the world's. Headings are in degrees, anticlockwise as seen from above with 0
along x: forward is (cos, sin), up is z. Rows are in recording order.

The TOML or JSON file with the CSV file's name (or the file of option `camera`) describes the
camera:

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
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct, field
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_document
from s2rtools.common.documents import convert
from s2rtools.common.lazy_sequence import chosen
from s2rtools.common.tables.csv_rows import missing_column, parse_float, read_rows
from s2rtools.datasets.dataset_config import (
    CameraTable,
    Coordinate,
    FieldOfViewCamera,
    IntrinsicsCamera,
    Positive,
)
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
    trajectory_name,
)
from s2rtools.datasets.recordings.recorded_files import FrameFiles
from s2rtools.datasets.recordings.recorded_poses import (
    in_optical_axes,
    level_poses,
    poses_from_quaternions,
)
from s2rtools.datasets.scan import choose_trajectories

_QUATERNION = ("qx", "qy", "qz", "qw")
_FULL = ("rgb", "x", "y", "z", *_QUATERNION)
_ON_FLOOR = ("rgb", "x", "y", "heading")
_COLUMNS = (*_FULL, "depth", "heading", "timestamp", "trajectory")
_OF_MANIFEST = "domain"
"""A column that only the manifest of `s2r ingest csv` has."""


class _Description(Struct, forbid_unknown_fields=True):
    """The keys of the file that describes the camera."""

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


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a CSV file and the description of its camera.

    Raises RequestError if one of them is missing or malformed.
    """
    if not path.is_file():
        reason = "a folder; name the CSV file in it" if path.is_dir() else "no such file"
        raise RequestError(f"{path}: {reason}")
    name = trajectory_name(path.stem)
    recording = Recording("csv", name, path.parent, allow_outside=options.allow_outside)
    description = _description_path(path, options, recording)
    document = read_document(description)
    if isinstance(document, dict) and {"bounds", "domains"} & document.keys():
        raise RequestError(
            f"{description}: a configuration of `s2r ingest csv` (bounds, domains); layout csv "
            "takes a file with a table [camera], which --sim-option or --real-option camera=FILE "
            "may name"
        )
    table = convert(document, _Description, str(description))
    _add_rows(recording, path, table, options)
    recording.camera = _camera(table, table.camera, "camera", description)
    if table.depth_camera is not None:
        recording.depth_camera = _camera(table, table.depth_camera, "depth_camera", description)
    recording.depth_scale, recording.depth_raw_max = table.depth_scale, table.depth_raw_max
    recording.up = (table.up[0], table.up[1], table.up[2]) if table.up else None
    recording.is_metric = table.metric
    recording.provenance = {"camera": description.name, "pose_axes": table.pose_axes}
    return recording


def _add_rows(recording: Recording, path: Path, table: _Description, options: ReadOptions) -> None:
    """Add the rows whose images exist, by trajectory, in order of their lines."""
    files, trajectories = FrameFiles(recording.root), dict[str, int]()
    values, times = array("d"), array("d")
    lines, codes = array("q"), array("q")
    columns: tuple[str, ...] = ()
    has_depth = False
    for line, row in read_rows(path, _COLUMNS, lambda names: _check_columns(path, names)):
        if not columns:
            columns, has_depth = _needed_columns(row)[1:], bool(row.get("depth"))
        depth, place = row.get("depth", ""), f"{path.name}:{line}"
        if depth and not has_depth:
            advice = "give depth in all rows or in none"
            raise RequestError(f"{path}:{line}: a depth image, but none in the first row; {advice}")
        if not row["rgb"] or (has_depth and not depth):
            recording.report("incomplete row", place, f"no {'depth' if row['rgb'] else 'rgb'}")
            continue
        images = [row["rgb"], depth] if has_depth else [row["rgb"]]
        found = [recording.has_image(name, f"{path}:{line}") for name in images]
        if not all(found):
            continue
        files.append(row["rgb"], depth if has_depth else None)
        name = row.get("trajectory") or recording.name
        codes.append(trajectories.setdefault(name, len(trajectories)))
        values.extend([parse_float(row[column]) for column in columns])
        times.append(parse_float(row.get("timestamp")))
        lines.append(line)
    if not columns:
        raise RequestError(f"{path}: no rows; the first line names {', '.join(_FULL)}")
    poses, frames = _poses(np.asarray(values).reshape(-1, len(columns)), table), files.frames()
    for name in choose_trajectories(options.trajectories, trajectories, path):
        kept = np.flatnonzero(np.asarray(codes) == trajectories[name])
        recording.trajectories[name] = RecordedTrajectory(
            chosen(frames, kept.tolist()), poses[kept], np.asarray(times)[kept],
            lambda row, kept=kept: f"{path.name}:{lines[kept[row]]}",  # type: ignore[misc]
        )  # fmt: skip


def _poses(values: NDArray[np.float64], table: _Description) -> NDArray[np.float64]:
    """Camera poses (N, 4, 4) of rows x, y, heading or x, y, z, qx, qy, qz, qw."""
    if values.shape[1] == 3:
        headings = np.radians(values[:, 2])
        return level_poses(np.column_stack([values[:, :2], headings]), table.camera_height)
    poses = poses_from_quaternions(values[:, :3], values[:, 3:])
    return in_optical_axes(poses) if table.pose_axes == "robot" else poses


def _check_columns(path: Path, names: Collection[str]) -> None:
    """Raises RequestError for a manifest of pairs, and if a column is missing."""
    if _OF_MANIFEST in names:
        raise RequestError(
            f"{path}: a manifest of both sides (column {_OF_MANIFEST}), which `s2r ingest csv` "
            "reads; layout csv takes a file for each side"
        )
    if missing := [name for name in _needed_columns(names) if name not in names]:
        other = f"{', '.join(_FULL)}; or {', '.join(_ON_FLOOR)}"
        raise missing_column(path, missing[0], names, other)


def _needed_columns(names: Collection[str]) -> tuple[str, ...]:
    return _FULL if any(name in names for name in _QUATERNION) else _ON_FLOOR


def _description_path(path: Path, options: ReadOptions, recording: Recording) -> Path:
    if stated := options.values.get("camera"):
        return Path(stated)
    for suffix in (".toml", ".json"):
        beside = path.with_suffix(suffix)
        if beside.is_file():
            return recording.containment.check(beside, str(path))
    raise RequestError(
        f"{path.with_suffix('.toml')}: missing; it describes the camera, unless --sim-option or "
        "--real-option camera=FILE names another file"
    )


def _camera(table: _Description, stated: dict[str, Any], key: str, path: Path) -> PinholeCamera:
    kind: type[CameraTable] = FieldOfViewCamera if "hfov" in stated else IntrinsicsCamera
    camera = convert(stated, kind, str(path), key=key)
    height, width = camera.size
    is_rgb = key == "camera"
    distortion = tuple(table.distortion) if is_rgb else ()
    return PinholeCamera(
        width, height, *camera.intrinsics(), distortion, table.fisheye and is_rgb
    ).checked(f"{path}: {key}")


LAYOUT = Layout(
    read,
    "CSV file of images and poses, with a TOML file that describes the camera",
    {"camera": "TOML or JSON file that describes the camera (default: that beside the CSV file)"},
)
