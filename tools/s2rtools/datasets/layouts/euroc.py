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
from s2rtools.common.yaml_files import read_yaml
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
    existing_folder,
)
from s2rtools.datasets.recordings.recorded_files import FrameFiles
from s2rtools.datasets.recordings.recorded_poses import orthonormal, poses_at, usable_poses
from s2rtools.datasets.recordings.stamped_lists import (
    read_image_list,
    read_pose_list,
    report_none_near,
)
from s2rtools.datasets.recordings.stated_cameras import image_size, opencv_camera

MAX_GAP = 0.1
"""Seconds between two poses that are interpolated."""
_RULE = "not between two poses at most 100 ms apart"
_NANOSECONDS = 1e9
_TRUTH = "state_groundtruth_estimate0"
_MODELS = ("radial-tangential", "radtan", "plumb_bob", "equidistant", "none")
_NAME = re.compile(r"[A-Za-z0-9_]{1,80}")


class _Matrix(Struct):
    data: Annotated[list[float], Meta(min_length=16, max_length=16)]


class _Sensor(Struct):
    """The part of a `sensor.yaml` that places the sensor."""

    T_BS: _Matrix


class _Camera(_Sensor):
    """The `sensor.yaml` of a camera."""

    camera_model: str
    intrinsics: Annotated[list[float], Meta(min_length=4, max_length=4)]
    distortion_model: str = "none"
    distortion_coefficients: list[float] = []
    resolution: Annotated[list[int], Meta(min_length=2, max_length=2)] | None = None


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a recording: the folder that holds `mav0`, or `mav0` itself.

    Raises RequestError if the camera, its calibration or the poses are missing or unusable.
    """
    is_inner = existing_folder(path).name == "mav0" and not (path / "mav0").is_dir()
    recording = Recording.of_folder("euroc", path.resolve().parent if is_inner else path, options)
    existing_folder(recording.root / "mav0")
    camera = _part(recording, f"cam{options.values.get('camera', '0')}", "camera")
    source = _part(recording, options.values.get("poses", _TRUTH), "poses")
    sensor_path = recording.resolve(f"mav0/{camera}/sensor.yaml")
    sensor = convert(read_yaml(sensor_path), _Camera, str(sensor_path), check=False)
    in_body = _mount(sensor, sensor_path)
    listed = f"mav0/{source}/data.csv"
    truth = read_pose_list(recording, listed, (5, 6, 7, 4), ",", _NANOSECONDS, more=True)
    body = truth.poses
    tracked = recording.resolve(f"mav0/{source}/sensor.yaml")
    if tracked.is_file():
        placed = convert(read_yaml(tracked), _Sensor, str(tracked), check=False)
        body = body @ np.linalg.inv(_mount(placed, tracked))
    folder = f"mav0/{camera}/data/"
    images = read_image_list(recording, f"mav0/{camera}/data.csv", folder, ",", _NANOSECONDS)
    poses = poses_at(images.times, truth.times, body, MAX_GAP, max_hold=0)
    posed = np.isfinite(poses).all(axis=(1, 2))
    lost = [(images.name(row), images.times[row]) for row in np.flatnonzero(~posed).tolist()]
    report_none_near(recording, "no pose", lost, truth.times, _RULE)
    files = FrameFiles(recording.root)
    for row in np.flatnonzero(posed).tolist():
        files.append(images.name(row))
    recording.trajectories[recording.only_name] = RecordedTrajectory(
        files.frames(), poses[posed] @ in_body, images.times[posed]
    )
    width, height = sensor.resolution or image_size(recording)[::-1]
    recording.camera = _pinhole(sensor, (height, width), sensor_path)
    recording.up = (0.0, 0.0, 1.0)
    recording.provenance = {"camera": camera, "poses": source, "max_gap_s": MAX_GAP}
    return recording


def _part(recording: Recording, name: str, option: str) -> str:
    """The name. Raises RequestError unless it is that of a folder in `mav0`."""
    mav = recording.root / "mav0"
    if not _NAME.fullmatch(name):
        raise RequestError(f"option {option}: {name!r}: use letters, digits and _")
    if not (mav / name).is_dir():
        found = ", ".join(sorted(each.name for each in mav.iterdir() if each.is_dir())) or "none"
        raise RequestError(
            f"{mav / name}: no such folder; option {option} names one (has: {found})"
        )
    return name


def _mount(sensor: _Sensor, path: Path) -> NDArray[np.float64]:
    """The pose (4, 4) of a sensor in the body's axes. Raises RequestError unless it is one."""
    pose = np.array(sensor.T_BS.data).reshape(1, 4, 4)
    if not usable_poses(pose)[0]:
        raise RequestError(f"{path}: T_BS: not a pose (rotation matrix and position in metres)")
    return orthonormal(pose)[0]


def _pinhole(sensor: _Camera, size: tuple[int, int], path: Path) -> PinholeCamera:
    """The camera for images of (height, width)."""
    if sensor.camera_model != "pinhole":
        raise RequestError(f"{path}: camera_model {sensor.camera_model!r}: expected pinhole")
    fx, fy, cx, cy = sensor.intrinsics
    model = sensor.distortion_model.lower()
    if model not in _MODELS:
        raise RequestError(
            f"{path}: distortion_model {sensor.distortion_model!r}: choose from "
            f"{', '.join(_MODELS)}"
        )
    distortion = () if model == "none" else tuple(sensor.distortion_coefficients)
    camera = opencv_camera(size, (fx, fy, cx, cy), distortion, model == "equidistant")
    return camera.checked(str(path))


LAYOUT = Layout(
    read,
    "EuRoC MAV / ASL recording: mav0/camN, mav0/state_groundtruth_estimate0",
    {
        "camera": "number of the camera: 0 (default) for mav0/cam0",
        "poses": f"folder in mav0 with the poses of the body: {_TRUTH} (default), vicon0, ...",
    },
)
