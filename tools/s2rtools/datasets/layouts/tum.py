"""TUM RGB-D: `rgb.txt`, `depth.txt` and `groundtruth.txt` beside the images that they name.

Lines are `time file` and `time tx ty tz qx qy qz qw`, seconds and metres; lines that begin with `#`
are comments. Poses are those of the colour camera's optical centre, axes x right, y down,
z forward, in a world whose z points up. Depth is stored with 5000 units per metre, 0 for none, and
is registered to the colour image pixel by pixel. RGB and depth images, and images and poses, belong
together if their times differ by at most 20 ms, as in the tools of the benchmark.

The calibrations are those of the colour cameras that the benchmark's page "File Formats" lists,
with the centre of the first pixel at 0: freiburg1, freiburg2 and freiburg3 by the folder's name
(`freiburg1` or `fr1`), else the default of ROS. Of the depth images the page states only that they
fit the colour images; registration ignores the distortion of both lenses, so that the pixels of
both agree to some pixels near the borders.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import (
    DEPTH_OPTION,
    WITHOUT_DEPTH,
    Layout,
    ReadOptions,
    Recording,
)
from s2rtools.datasets.recordings.frame_table import FrameTable
from s2rtools.datasets.recordings.recorded_poses import mutual_nearest, poses_near
from s2rtools.datasets.recordings.stamped_lists import (
    read_image_list,
    read_pose_list,
    report_none_near,
)
from s2rtools.datasets.recordings.stated_cameras import CAMERA_OPTION, fitted_camera, opencv_camera

UNITS_PER_METRE = 5000
TOLERANCE = 0.02
"""Seconds between the times of what belongs together."""
_RULE = f"none within {TOLERANCE * 1000:g} ms"
_LIMIT = TOLERANCE + 1e-6
"""Times since 1970 are rounded to 0.2 microseconds."""
_SIZE = (480, 640)
_CAMERAS = {
    "1": opencv_camera(
        _SIZE, (517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
    ),
    "2": opencv_camera(
        _SIZE, (520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)
    ),
    "3": opencv_camera(_SIZE, (535.4, 539.2, 320.1, 247.6)),
}
_SENSOR = re.compile(r"(?<![A-Za-z])(?:freiburg|fr)([123])(?![0-9])")
"""The benchmark writes freiburg1 and fr1."""
_ROS_DEFAULT = opencv_camera(_SIZE, (525.0, 525.0, 319.5, 239.5))


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a sequence of the layout. Raises RequestError if a list is missing or unusable."""
    recording = Recording.of_folder("tum", path, options)
    rgb, depth = read_image_list(recording, "rgb.txt"), None
    truth = read_pose_list(recording, "groundtruth.txt")
    poses = poses_near(rgb.times, truth.times, truth.poses, _LIMIT)
    posed = np.isfinite(poses).all(axis=(1, 2))
    paired, depth_rows = np.ones(len(poses), dtype=bool), np.zeros(len(poses), dtype=np.intp)
    needed = [("no pose", posed, truth.times)]
    if options.reads_depth:
        if not (path / "depth.txt").is_file():
            raise RequestError(f"{path / 'depth.txt'}: missing; {WITHOUT_DEPTH}")
        depth = read_image_list(recording, "depth.txt")
        depth_rows = mutual_nearest(rgb.times, depth.times, _LIMIT)
        paired = depth_rows >= 0
        needed.insert(0, ("no depth image", paired, depth.times))
    for kind, found, known in needed:
        images = [(rgb.name(row), rgb.times[row]) for row in np.flatnonzero(~found).tolist()]
        report_none_near(recording, kind, images, known, _RULE)
    usable = np.flatnonzero(posed & paired)
    table = FrameTable(recording)
    for row in usable.tolist():
        depth_name = None if depth is None else depth.name(int(depth_rows[row]))
        table.add(rgb.name(row), depth_name, poses[row].ravel(), rgb.times[row])
    table.fill()
    sensor = _SENSOR.search(path.resolve().name)
    default = _CAMERAS[sensor[1]] if sensor else _ROS_DEFAULT
    source = f"freiburg{sensor[1]} of the benchmark" if sensor else "default of ROS"
    recording.camera = fitted_camera(recording, options, "camera", default)
    recording.depth_scale, recording.up = 1 / UNITS_PER_METRE, (0.0, 0.0, 1.0)
    source = "option camera" if "camera" in options.values else source
    recording.provenance = {"camera": source, "tolerance_s": TOLERANCE}
    return recording


LAYOUT = Layout(
    read,
    "TUM RGB-D sequence: rgb.txt, depth.txt, groundtruth.txt",
    {"camera": CAMERA_OPTION, "depth": DEPTH_OPTION},
)
