"""EuRoC MAV and other recordings in the ASL layout: folder `mav0`.

`camN/data.csv` names the images in `camN/data` with their times in nanoseconds. `camN/sensor.yaml`
holds the pose of the camera in the body's axes (`T_BS`), `intrinsics` fu, fv, cu, cv and the
distortion, radial-tangential (k1, k2, p1, p2 as in OpenCV) or equidistant (that of `cv2.fisheye`).
The layout does not state where the pixels' centres are; the calibrations of EuRoC were made by
Kalibr, whose convention is OpenCV's: the centre of the first pixel is 0.

`state_groundtruth_estimate0/data.csv` holds time, position and quaternion (w, x, y, z) of the body
in a world whose z points up; option `poses` names another folder of that form, such as `vicon0`.
The `T_BS` of its `sensor.yaml` is the pose of the tracked sensor in the body's axes. Poses at the
times of the images are interpolated between rows that are at most 100 ms apart; rows come with
200 Hz in EuRoC. Images before the first row or behind the last one have no pose. Images are grey,
and there is no depth.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.documents import convert
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import in_time_order, read_numbers, read_stamped_names
from s2rtools.common.yaml_files import read_yaml
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.recorded_files import FrameFiles, commonest_size, find_file
from s2rtools.datasets.recordings.recorded_folders import (
    existing_folder,
    folder_name,
    report_none_near,
    require_frames,
    trajectory_name,
)
from s2rtools.datasets.recordings.recorded_poses import (
    orthonormal,
    poses_at,
    poses_from_quaternions,
    report_unusable,
    usable_poses,
)
from s2rtools.datasets.recordings.stated_cameras import checked, opencv_camera
from s2rtools.datasets.scan import choose_trajectories

MAX_GAP = 0.1
"""Seconds between two poses that are interpolated."""
_RULE = "not between two poses at most 100 ms apart"
_NANOSECONDS = 1e9
_TRUTH = "state_groundtruth_estimate0"
_RADIAL = ("radial-tangential", "radtan", "plumb_bob")
_NAME = re.compile(r"[A-Za-z0-9_]{1,80}")
_ROTATION_LIMIT = 1e-3

Size = Annotated[list[int], Meta(min_length=2, max_length=2)]


class _Matrix(Struct):
    data: Annotated[list[float], Meta(min_length=16, max_length=16)]


class _Pose(Struct):
    """The part of a `sensor.yaml` that places the sensor."""

    T_BS: _Matrix


class _Camera(Struct):
    """The `sensor.yaml` of a camera."""

    T_BS: _Matrix
    camera_model: str
    intrinsics: Annotated[list[float], Meta(min_length=4, max_length=4)]
    distortion_model: str = "none"
    distortion_coefficients: list[float] = []
    resolution: Size | None = None


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a recording: the folder that holds `mav0`, or `mav0` itself.

    Raises RequestError if the camera, its calibration or the poses are missing or unusable.
    """
    folder = existing_folder(path)
    if folder.name == "mav0" and not (folder / "mav0").is_dir():
        folder = folder.resolve().parent
    mav = existing_folder(folder / "mav0")
    containment = PathContainment(folder, options.allow_outside)
    issues: list[InputIssue] = []
    camera = _part(mav, f"cam{options.values.get('camera', '0')}", "camera")
    source = _part(mav, options.values.get("poses", _TRUTH), "poses")
    sensor_path = containment.resolve(f"mav0/{camera}/sensor.yaml", str(folder))
    sensor = convert(read_yaml(sensor_path), _Camera, str(sensor_path), check=False)
    in_body = _matrix(sensor.T_BS, sensor_path)

    known_times, body_poses = _body_poses(folder, source, containment, issues)
    listed = f"mav0/{camera}/data.csv"
    images = read_stamped_names(containment.resolve(listed, str(folder)), listed, issues, ",")
    order = in_time_order(images, issues)
    times = images.values[:, 0] / _NANOSECONDS
    poses = poses_at(times[order], known_times, body_poses, MAX_GAP, max_hold=0)
    posed = np.isfinite(poses).all(axis=(1, 2))
    names = [f"mav0/{camera}/data/{images.text(row)}" for row in order[~posed].tolist()]
    report_none_near("no pose", names, times[order[~posed]], known_times, MAX_GAP, issues, _RULE)

    files, kept = FrameFiles(folder), []
    for number in np.flatnonzero(posed).tolist():
        row = int(order[number])
        name = f"mav0/{camera}/data/{images.text(row)}"
        if find_file(containment, name, f"{folder / images.place(row)}", issues):
            files.append(name)
            kept.append(number)
    frames = files.chosen(range(len(files)))
    trajectory = trajectory_name(folder_name(folder))
    choose_trajectories(options.trajectories, [trajectory], path)
    trajectories = {
        trajectory: RecordedTrajectory(
            frames, orthonormal(poses[kept] @ in_body), times[order[kept]]
        )
    }
    require_frames("euroc", folder, trajectories, issues)
    size = (sensor.resolution[1], sensor.resolution[0]) if sensor.resolution else None
    return Recording(
        layout="euroc",
        name=folder_name(folder),
        root=folder,
        camera=_pinhole(sensor, size or commonest_size(frames, folder), sensor_path),
        up=(0.0, 0.0, 1.0),
        trajectories=trajectories,
        issues=issues,
        provenance={"camera": camera, "poses": source, "max_gap_s": MAX_GAP},
        outside_folders=containment.outside_folders,
    )


def _part(mav: Path, name: str, option: str) -> str:
    """The name. Raises RequestError unless it is that of a folder in `mav0`."""
    if not _NAME.fullmatch(name):
        raise RequestError(f"option {option}: {name!r}: use letters, digits and _")
    if not (mav / name).is_dir():
        found = ", ".join(sorted(each.name for each in mav.iterdir() if each.is_dir())) or "none"
        raise RequestError(
            f"{mav / name}: no such folder; option {option} names one (has: {found})"
        )
    return name


def _body_poses(
    folder: Path, source: str, containment: PathContainment, issues: list[InputIssue]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (K,), seconds, ascending, and poses (K, 4, 4) of the body."""
    name = f"mav0/{source}/data.csv"
    path = containment.resolve(name, str(folder))
    rows = read_numbers(path, name, 8, issues, ",", more=True)
    quaternions = rows.values[:, [5, 6, 7, 4]]
    poses = poses_from_quaternions(rows.values[:, 1:4], quaternions)
    usable = np.flatnonzero(report_unusable(poses, rows.place, issues, quaternions))
    kept = rows.chosen(usable)
    order = in_time_order(kept, issues)
    sensor = containment.resolve(f"mav0/{source}/sensor.yaml", str(folder))
    poses = poses[usable[order]]
    if sensor.is_file():
        placed = convert(read_yaml(sensor), _Pose, str(sensor), check=False)
        poses = poses @ np.linalg.inv(_matrix(placed.T_BS, sensor))
    return kept.values[order, 0] / _NANOSECONDS, poses


def _matrix(table: _Matrix, path: Path) -> NDArray[np.float64]:
    """A pose (4, 4). Raises RequestError unless it is one."""
    pose = np.array(table.data).reshape(4, 4)
    if not usable_poses(pose[None])[0]:
        raise RequestError(f"{path}: T_BS: not a pose (rotation matrix and position in metres)")
    return orthonormal(pose[None])[0]


def _pinhole(sensor: _Camera, size: tuple[int, int], path: Path) -> PinholeCamera:
    """The camera for images of (height, width)."""
    if sensor.camera_model != "pinhole":
        raise RequestError(f"{path}: camera_model {sensor.camera_model!r}: expected pinhole")
    fx, fy, cx, cy = sensor.intrinsics
    coefficients = tuple(sensor.distortion_coefficients)
    model = sensor.distortion_model.lower()
    if model not in (*_RADIAL, "equidistant", "none"):
        known = ", ".join((*_RADIAL, "equidistant", "none"))
        raise RequestError(
            f"{path}: distortion_model {sensor.distortion_model!r}: choose from {known}"
        )
    if model == "none":
        coefficients = ()
    camera = opencv_camera(size, (fx, fy, cx, cy), coefficients, model == "equidistant")
    return checked(camera, str(path))


LAYOUT = Layout(
    read,
    "EuRoC MAV / ASL recording: mav0/camN, mav0/state_groundtruth_estimate0",
    {
        "camera": "number of the camera: 0 (default) for mav0/cam0",
        "poses": f"folder in mav0 with the poses of the body: {_TRUTH} (default), vicon0, ...",
    },
)
