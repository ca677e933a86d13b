"""ScanNet, as its exporter writes a scan: `color/N.jpg`, `depth/N.png`, `pose/N.txt`.

`intrinsic/intrinsic_color.txt` and `intrinsic/intrinsic_depth.txt` are 4x4 matrices in pixels of
each image; they may also be `intrinsics_color.txt` and `intrinsics_depth.txt` beside the folders,
as in the published subset of 25,000 frames. Poses are matrices from the axes of the camera (x
right, y down, z forward) to the world, metres, whose z points up to the accuracy of the alignment
of the scan. A pose of `-inf` says that tracking failed: the frame is left out and reported. Depth
is in millimetres, 0 for none.

The data set does not state where the pixels' centres are. Its principal points of the depth camera
lie at 319.5, 239.5 in images of 640x480, so the centre of the first pixel is taken as 0, as in
OpenCV. Poses are taken as those of both cameras: `extrinsic_color.txt` and `extrinsic_depth.txt`,
which are the identity in published scans, are reported if they are not.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.numeric_rows import read_matrix
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import Layout, PinholeCamera, ReadOptions, Recording
from s2rtools.datasets.recordings.pose_files import NumberedFrames, read_frames
from s2rtools.datasets.recordings.recorded_files import NumberedFiles, commonest_size
from s2rtools.datasets.recordings.recorded_folders import (
    existing_folder,
    folder_name,
    require_frames,
    trajectory_name,
)
from s2rtools.datasets.recordings.stated_cameras import checked, opencv_camera
from s2rtools.datasets.scan import choose_trajectories

_RGB = re.compile(r"([0-9]+)\.(?:jpg|jpeg|png)", re.IGNORECASE)
_DEPTH = re.compile(r"([0-9]+)\.png", re.IGNORECASE)
_POSE = re.compile(r"([0-9]+)\.txt")
_PLACES = ("intrinsic/intrinsic_{}.txt", "intrinsics_{}.txt", "intrinsic_{}.txt")
_SKEW_LIMIT = 1e-3
"""Share of the focal length."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read an exported scan. Raises RequestError if a folder or the intrinsics are missing."""
    folder = existing_folder(path)
    containment = PathContainment(folder, options.allow_outside)
    issues: list[InputIssue] = []
    files = NumberedFrames(
        NumberedFiles(existing_folder(folder / "color"), _RGB),
        NumberedFiles(existing_folder(folder / "depth"), _DEPTH),
        NumberedFiles(existing_folder(folder / "pose"), _POSE),
        "color/",
        "depth/",
        "pose/",
    )
    name = trajectory_name(folder_name(folder))
    choose_trajectories(options.trajectories, [name], path)
    trajectory = read_frames(folder, files, containment, issues)
    require_frames("scannet", folder, {name: trajectory}, issues)
    size = commonest_size(trajectory.frames, folder)
    depth_size = commonest_size(trajectory.frames, folder, depth=True)
    return Recording(
        layout="scannet",
        name=folder_name(folder),
        root=folder,
        camera=_camera(folder, "color", size, containment, issues),
        depth_camera=_camera(folder, "depth", depth_size, containment, issues),
        up=(0.0, 0.0, 1.0),
        trajectories={name: trajectory},
        issues=issues,
        outside_folders=containment.outside_folders,
    )


def _camera(
    folder: Path,
    kind: str,
    size: tuple[int, int],
    containment: PathContainment,
    issues: list[InputIssue],
) -> PinholeCamera:
    """The camera of the images `kind`, which are of (height, width)."""
    names = [place.format(kind) for place in _PLACES]
    name = next((each for each in names if (folder / each).is_file()), None)
    if name is None:
        raise RequestError(f"{folder / names[0]}: missing; export the intrinsics of the scan")
    path = containment.resolve(name, str(folder))
    matrix = read_matrix(path, 4, 4)
    if not np.isfinite(matrix).all():
        raise RequestError(f"{path}: the intrinsics are not finite")
    extrinsic = Path(name).with_name(path.name.replace("intrinsic", "extrinsic")).as_posix()
    if (folder / extrinsic).is_file():
        offset = read_matrix(containment.resolve(extrinsic, str(folder)), 4, 4)
        if not np.abs(offset - np.eye(4)).max() <= 1e-6:
            detail = "not the identity; poses are taken as those of this camera nevertheless"
            issues.append(InputIssue("extrinsics ignored", extrinsic, detail))
    if abs(matrix[0, 1]) > _SKEW_LIMIT * abs(matrix[0, 0]):
        raise RequestError(f"{path}: the camera has skew {matrix[0, 1]:g}, which is not supported")
    values = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    fx, fy, cx, cy = (float(value) for value in values)
    camera = checked(opencv_camera(size, (fx, fy, cx, cy)), str(path))
    if not (0 < camera.cx < camera.width and 0 < camera.cy < camera.height):
        detail = f"principal point {cx:g}, {cy:g} outside of images of {size[1]}x{size[0]}"
        issues.append(InputIssue("intrinsics of another size", name, detail))
    return camera


LAYOUT = Layout(read, "exported ScanNet scan: color/, depth/, pose/, intrinsic/")
