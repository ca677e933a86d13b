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
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import (
    NumericRows,
    in_time_order,
    read_numbers,
    read_stamped_names,
)
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
    mutual_nearest,
    orthonormal,
    poses_from_quaternions,
    poses_near,
    report_unusable,
)
from s2rtools.datasets.recordings.stated_cameras import (
    CAMERA_OPTION,
    camera_option,
    fit_to_images,
    opencv_camera,
)
from s2rtools.datasets.scan import choose_trajectories

UNITS_PER_METRE = 5000
TOLERANCE = 0.02
"""Seconds between the times of what belongs together."""
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


@dataclass(frozen=True, slots=True, eq=False)
class _Images:
    """The images of a list that exist, by time."""

    rows: NumericRows
    order: NDArray[np.intp]

    @property
    def times(self) -> NDArray[np.float64]:
        return np.asarray(self.rows.values[self.order, 0])

    def name(self, number: int) -> str:
        return self.rows.text(int(self.order[number]))


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a sequence of the layout. Raises RequestError if a list is missing or unusable."""
    folder = existing_folder(path)
    containment = PathContainment(folder, options.allow_outside)
    issues: list[InputIssue] = []
    rgb = _images(folder, "rgb.txt", containment, issues)
    depth = _images(folder, "depth.txt", containment, issues)
    truth = read_numbers(folder / "groundtruth.txt", "groundtruth.txt", 8, issues)
    known_times, known_poses = _known_poses(truth, issues)

    times = rgb.times
    depth_rows = mutual_nearest(times, depth.times, _LIMIT)
    poses = poses_near(times, known_times, known_poses, _LIMIT)
    posed = np.isfinite(poses).all(axis=(1, 2))
    for kind, missing, known in (
        ("no depth image", depth_rows < 0, depth.times),
        ("no pose", ~posed, known_times),
    ):
        rows = np.flatnonzero(missing)
        names = [rgb.name(row) for row in rows.tolist()]
        report_none_near(kind, names, times[rows], known, TOLERANCE, issues)
    usable = np.flatnonzero(posed & (depth_rows >= 0))
    files = FrameFiles(folder)
    for row in usable.tolist():
        files.append(rgb.name(row), depth.name(int(depth_rows[row])))
    frames = files.chosen(range(len(files)))
    name = trajectory_name(folder_name(folder))
    choose_trajectories(options.trajectories, [name], path)
    trajectories = {name: RecordedTrajectory(frames, orthonormal(poses[usable]), times[usable])}
    require_frames("tum", folder, trajectories, issues)
    camera, source = _camera(folder, options, commonest_size(frames, folder), issues)
    return Recording(
        layout="tum",
        name=folder_name(folder),
        root=folder,
        camera=camera,
        depth_scale=1 / UNITS_PER_METRE,
        up=(0.0, 0.0, 1.0),
        trajectories=trajectories,
        issues=issues,
        provenance={"camera": source, "tolerance_s": TOLERANCE},
        outside_folders=containment.outside_folders,
    )


def _images(
    folder: Path, name: str, containment: PathContainment, issues: list[InputIssue]
) -> _Images:
    rows = read_stamped_names(folder / name, name, issues)
    order = in_time_order(rows, issues)
    found = [
        find_file(containment, rows.text(row), f"{folder / rows.place(row)}", issues)
        for row in order.tolist()
    ]
    return _Images(rows, order[np.asarray(found, dtype=bool)])


def _known_poses(
    truth: NumericRows, issues: list[InputIssue]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (K,), ascending, and poses (K, 4, 4) of the usable rows."""
    quaternions = truth.values[:, 4:8]
    poses = poses_from_quaternions(truth.values[:, 1:4], quaternions)
    usable = report_unusable(poses, truth.place, issues, quaternions)
    rows = np.flatnonzero(usable)
    kept = truth.chosen(rows)
    order = in_time_order(kept, issues)
    return kept.values[order, 0], poses[rows[order]]


def _camera(
    folder: Path, options: ReadOptions, size: tuple[int, int], issues: list[InputIssue]
) -> tuple[PinholeCamera, str]:
    """The camera, and where it comes from."""
    stated = camera_option(options, "camera", size)
    if stated is not None:
        return fit_to_images(stated, size, folder, issues), "option camera"
    if found := _SENSOR.search(folder.resolve().name):
        camera = fit_to_images(_CAMERAS[found[1]], size, folder, issues)
        return camera, f"freiburg{found[1]} of the benchmark"
    return fit_to_images(_ROS_DEFAULT, size, folder, issues), "default of ROS"


LAYOUT = Layout(
    read,
    "TUM RGB-D sequence: rgb.txt, depth.txt, groundtruth.txt",
    {"camera": CAMERA_OPTION},
)
