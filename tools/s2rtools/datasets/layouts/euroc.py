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

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import (
    Layout,
    ReadOptions,
    Recording,
    existing_folder,
)
from s2rtools.datasets.recordings.frame_table import FrameTable
from s2rtools.datasets.recordings.recorded_poses import poses_at
from s2rtools.datasets.recordings.sensor_file import CameraSensor, Sensor, read_sensor
from s2rtools.datasets.recordings.stamped_lists import (
    read_image_list,
    read_pose_list,
    report_none_near,
)
from s2rtools.datasets.recordings.stated_cameras import image_size

MAX_GAP = 0.1
"""Seconds between two poses that are interpolated."""
_RULE = "not between two poses at most 100 ms apart"
_NANOSECONDS = 1e9
_TRUTH = "state_groundtruth_estimate0"
_NAME = re.compile(r"[A-Za-z0-9_]{1,80}")


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
    sensor = read_sensor(sensor_path, CameraSensor)
    in_body = sensor.mount(sensor_path)
    listed = f"mav0/{source}/data.csv"
    truth = read_pose_list(recording, listed, (5, 6, 7, 4), ",", _NANOSECONDS, more=True)
    body = truth.poses
    tracked = recording.resolve(f"mav0/{source}/sensor.yaml")
    if tracked.is_file():
        body = body @ np.linalg.inv(read_sensor(tracked, Sensor).mount(tracked))
    folder = f"mav0/{camera}/data/"
    images = read_image_list(recording, f"mav0/{camera}/data.csv", folder, ",", _NANOSECONDS)
    poses = poses_at(images.times, truth.times, body, MAX_GAP, max_hold=0)
    posed = np.isfinite(poses).all(axis=(1, 2))
    lost = [(images.name(row), images.times[row]) for row in np.flatnonzero(~posed).tolist()]
    report_none_near(recording, "no pose", lost, truth.times, _RULE)
    table = FrameTable(recording)
    for row in np.flatnonzero(posed).tolist():
        table.add(images.name(row), None, (poses[row] @ in_body).ravel(), images.times[row])
    table.fill()
    width, height = sensor.resolution or image_size(recording)[::-1]
    recording.camera = sensor.pinhole((height, width), sensor_path)
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


LAYOUT = Layout(
    read,
    "EuRoC MAV / ASL recording: mav0/camN, mav0/state_groundtruth_estimate0",
    {
        "camera": "number of the camera: 0 (default) for mav0/cam0",
        "poses": f"folder in mav0 with the poses of the body: {_TRUTH} (default), vicon0, ...",
    },
)
