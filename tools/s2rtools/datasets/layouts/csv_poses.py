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
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct, field
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_document
from s2rtools.common.documents import convert
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.csv_rows import missing_column, parse_float, read_rows
from s2rtools.datasets.dataset_config import (
    CameraTable,
    Coordinate,
    FieldOfViewCamera,
    IntrinsicsCamera,
    Positive,
)
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.recorded_files import FrameFiles, find_file
from s2rtools.datasets.recordings.recorded_folders import require_frames, trajectory_name
from s2rtools.datasets.recordings.recorded_poses import (
    FORWARD_TO_OPTICAL,
    orthonormal,
    poses_from_quaternions,
    report_unusable,
)
from s2rtools.datasets.recordings.stated_cameras import checked
from s2rtools.datasets.scan import choose_trajectories

_POSITION = ("x", "y", "z")
_QUATERNION = ("qx", "qy", "qz", "qw")
_COLUMNS = ("rgb", "depth", *_POSITION, *_QUATERNION, "heading", "timestamp", "trajectory")
_OF_MANIFEST = "domain"
"""A column that only the manifest of `s2r ingest csv` has."""
_FULL = ("rgb", *_POSITION, *_QUATERNION)
_ON_FLOOR = ("rgb", "x", "y", "heading")


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


class _Rows:
    """The rows of a CSV file whose images exist, in order of their lines."""

    def __init__(self, path: Path, containment: PathContainment, issues: list[InputIssue]) -> None:
        """Raises RequestError if there is no row, or a column is missing."""
        self.path = path
        self.files = FrameFiles(path.parent)
        self.trajectories: dict[str, int] = {}
        self.columns: tuple[str, ...] = ()
        self._values, self._times = array("d"), array("d")
        self._lines, self._numbers = array("i"), array("i")
        has_depth = False
        for line, row in read_rows(path, _COLUMNS, partial(_check_columns, path)):
            if not self.columns:
                self.columns = _pose_columns(row)
                has_depth = bool(row.get("depth"))
            if _has_images(row, has_depth, path, line, containment, issues):
                self._add(line, row, has_depth)
        if not self.columns:
            raise RequestError(f"{path}: no rows; the first line names {', '.join(_FULL)}")

    def _add(self, line: int, row: dict[str, str], has_depth: bool) -> None:
        name = row.get("trajectory") or trajectory_name(self.path.stem)
        self.files.append(row["rgb"], row["depth"] if has_depth else None)
        self._numbers.append(self.trajectories.setdefault(name, len(self.trajectories)))
        self._values.extend([parse_float(row[column]) for column in self.columns])
        self._times.append(parse_float(row.get("timestamp")))
        self._lines.append(line)

    @property
    def values(self) -> NDArray[np.float64]:
        """(N, columns)"""
        return np.asarray(self._values).reshape(-1, len(self.columns))

    @property
    def times(self) -> NDArray[np.float64]:
        """(N,) seconds, NaN where a row states none."""
        return np.asarray(self._times)

    @property
    def numbers(self) -> NDArray[np.int32]:
        """(N,) the position of each row's trajectory in `trajectories`."""
        return np.asarray(self._numbers, dtype=np.int32)

    def place(self, row: int) -> str:
        """`FILE:LINE` of a row."""
        return f"{self.path.name}:{self._lines[row]}"


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a CSV file and the description of its camera.

    Raises RequestError if one of them is missing or malformed.
    """
    if path.is_dir():
        raise RequestError(f"{path}: a folder; name the CSV file in it")
    if not path.is_file():
        raise RequestError(f"{path}: no such file")
    containment = PathContainment(path.parent, options.allow_outside)
    description = _description_path(path, options, containment)
    document = read_document(description)
    if isinstance(document, dict) and {"bounds", "domains"} & document.keys():
        raise RequestError(
            f"{description}: a configuration of `s2r ingest csv` (bounds, domains); layout csv "
            "takes a file with a table [camera], which --sim-option or --real-option camera=FILE "
            "may name"
        )
    table = convert(document, _Description, str(description))
    issues: list[InputIssue] = []
    rows = _Rows(path, containment, issues)
    poses = _poses(rows, table, issues)
    names = choose_trajectories(options.trajectories, rows.trajectories, path)
    usable = np.isfinite(poses).all(axis=(1, 2))
    trajectories = {}
    for name in names:
        kept = np.flatnonzero((rows.numbers == rows.trajectories[name]) & usable)
        if len(kept):
            frames = rows.files.chosen(kept.tolist())
            trajectories[name] = RecordedTrajectory(
                frames, orthonormal(poses[kept]), rows.times[kept]
            )
        else:
            issues.append(InputIssue("empty trajectory", name, "no usable row"))
    require_frames("csv", path, trajectories, issues)
    depth = table.depth_camera
    return Recording(
        layout="csv",
        name=trajectory_name(path.stem),
        root=path.parent,
        camera=_camera(table, table.camera, "camera", description),
        depth_camera=None if depth is None else _camera(table, depth, "depth_camera", description),
        depth_scale=table.depth_scale,
        depth_raw_max=table.depth_raw_max,
        up=(table.up[0], table.up[1], table.up[2]) if table.up else None,
        is_metric=table.metric,
        trajectories=trajectories,
        issues=issues,
        provenance={"camera": description.name, "pose_axes": table.pose_axes},
        outside_folders=containment.outside_folders,
    )


def _has_images(
    row: dict[str, str],
    has_depth: bool,
    path: Path,
    line: int,
    containment: PathContainment,
    issues: list[InputIssue],
) -> bool:
    """Whether the images of a row exist; reports a row without them.

    Raises RequestError if the row names a depth image and the first row does not.
    """
    depth = row.get("depth", "")
    if depth and not has_depth:
        advice = "give depth in all rows or in none"
        raise RequestError(f"{path}:{line}: a depth image, but none in the first row; {advice}")
    if not row["rgb"] or (has_depth and not depth):
        missing = "depth" if row["rgb"] else "rgb"
        issues.append(InputIssue("incomplete row", f"{path.name}:{line}", f"no {missing}"))
        return False
    names = [row["rgb"], depth] if has_depth else [row["rgb"]]
    found = [find_file(containment, name, f"{path}:{line}", issues) for name in names]
    return all(found)


def _check_columns(path: Path, names: Collection[str]) -> None:
    """Raises RequestError for a manifest of pairs, and if a column is missing."""
    if _OF_MANIFEST in names:
        raise RequestError(
            f"{path}: a manifest of both sides (column {_OF_MANIFEST}), which `s2r ingest csv` "
            "reads; layout csv takes a file for each side"
        )
    needed = _needed_columns(names)
    if missing := [name for name in needed if name not in names]:
        other = f"{', '.join(_FULL)}; or {', '.join(_ON_FLOOR)}"
        raise missing_column(path, missing[0], names, other)


def _needed_columns(names: Collection[str]) -> tuple[str, ...]:
    return _FULL if any(name in names for name in _QUATERNION) else _ON_FLOOR


def _pose_columns(names: Collection[str]) -> tuple[str, ...]:
    """The columns of the pose."""
    return _needed_columns(names)[1:]


def _description_path(path: Path, options: ReadOptions, containment: PathContainment) -> Path:
    if stated := options.values.get("camera"):
        return Path(stated)
    for suffix in (".toml", ".json"):
        beside = path.with_suffix(suffix)
        if beside.is_file():
            return containment.check(beside, str(path))
    raise RequestError(
        f"{path.with_suffix('.toml')}: missing; it describes the camera, unless --sim-option or "
        "--real-option camera=FILE names another file"
    )


def _poses(rows: _Rows, table: _Description, issues: list[InputIssue]) -> NDArray[np.float64]:
    """(N, 4, 4), NaN where a row's pose is unusable."""
    values = rows.values
    if "heading" in rows.columns:
        turns = np.zeros((len(values), 3))
        turns[:, 2] = np.radians(values[:, 2])
        quaternions = np.full((len(values), 4), np.nan)
        finite = np.isfinite(turns).all(axis=1)
        quaternions[finite] = Rotation.from_rotvec(turns[finite]).as_quat()
        height = np.full((len(values), 1), table.camera_height)
        poses = poses_from_quaternions(np.hstack([values[:, :2], height]), quaternions)
        usable = report_unusable(poses, rows.place, issues)
    else:
        poses = poses_from_quaternions(values[:, :3], values[:, 3:])
        usable = report_unusable(poses, rows.place, issues, values[:, 3:])
    if "heading" in rows.columns or table.pose_axes == "robot":
        poses = poses @ FORWARD_TO_OPTICAL
    poses[~usable] = np.nan
    return poses


def _camera(table: _Description, stated: dict[str, Any], key: str, path: Path) -> PinholeCamera:
    kind: type[CameraTable] = FieldOfViewCamera if "hfov" in stated else IntrinsicsCamera
    camera = convert(stated, kind, str(path), key=key)
    height, width = camera.size
    fx, fy, cx, cy = camera.intrinsics()
    distortion = tuple(table.distortion) if key == "camera" else ()
    is_fisheye = table.fisheye and key == "camera"
    return checked(
        PinholeCamera(width, height, fx, fy, cx, cy, distortion, is_fisheye), f"{path}: {key}"
    )


LAYOUT = Layout(
    read,
    "CSV file of images and poses, with a TOML file that describes the camera",
    {"camera": "TOML or JSON file that describes the camera (default: that beside the CSV file)"},
)
