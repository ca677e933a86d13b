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
from s2rtools.common.tables.numeric_rows import read_matrix
from s2rtools.datasets.recording import (
    DEPTH_OPTION,
    WITHOUT_DEPTH,
    Layout,
    PinholeCamera,
    ReadOptions,
    Recording,
)
from s2rtools.datasets.recordings.frame_table import read_frames
from s2rtools.datasets.recordings.stated_cameras import image_size, opencv_camera

_FILES = {
    "rgb": ("color/", re.compile(r"([0-9]+)\.(?:jpg|jpeg|png)", re.IGNORECASE)),
    "depth": ("depth/", re.compile(r"([0-9]+)\.png", re.IGNORECASE)),
    "pose": ("pose/", re.compile(r"([0-9]+)\.txt")),
}
_PLACES = ("intrinsic/intrinsic_{}.txt", "intrinsics_{}.txt", "intrinsic_{}.txt")
_SKEW_LIMIT = 1e-3
"""Share of the focal length."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read an exported scan. Raises RequestError if a folder or the intrinsics are missing."""
    recording = Recording.of_folder("scannet", path, options)
    files = {kind: each for kind, each in _FILES.items() if kind != "depth" or options.reads_depth}
    if options.reads_depth and not (path / "depth").is_dir():
        raise RequestError(f"{path / 'depth'}: no such folder; {WITHOUT_DEPTH}")
    read_frames(recording, files)
    recording.camera = _camera(recording, "color", image_size(recording))
    if options.reads_depth:
        recording.depth_camera = _camera(recording, "depth", image_size(recording, depth=True))
    recording.up = (0.0, 0.0, 1.0)
    return recording


def _camera(recording: Recording, kind: str, size: tuple[int, int]) -> PinholeCamera:
    """The camera of the images `kind`, which are of (height, width)."""
    names = [place.format(kind) for place in _PLACES]
    name = next((each for each in names if (recording.root / each).is_file()), None)
    if name is None:
        missing = recording.root / names[0]
        raise RequestError(f"{missing}: missing; export the intrinsics of the scan")
    path = recording.resolve(name)
    matrix = read_matrix(path, 4, 4)
    if not np.isfinite(matrix).all():
        raise RequestError(f"{path}: the intrinsics are not finite")
    extrinsic = Path(name).with_name(path.name.replace("intrinsic", "extrinsic")).as_posix()
    if (recording.root / extrinsic).is_file():
        offset = read_matrix(recording.resolve(extrinsic), 4, 4)
        if not np.abs(offset - np.eye(4)).max() <= 1e-6:
            detail = "not the identity; poses are taken as those of this camera nevertheless"
            recording.report("extrinsics ignored", extrinsic, detail)
    if abs(matrix[0, 1]) > _SKEW_LIMIT * abs(matrix[0, 0]):
        raise RequestError(f"{path}: the camera has skew {matrix[0, 1]:g}, which is not supported")
    values = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    fx, fy, cx, cy = (float(value) for value in values)
    camera = opencv_camera(size, (fx, fy, cx, cy)).checked(str(path))
    if not (0 < camera.cx < camera.width and 0 < camera.cy < camera.height):
        detail = f"principal point {cx:g}, {cy:g} outside of images of {size[1]}x{size[0]}"
        recording.report("intrinsics of another size", name, detail)
    return camera


LAYOUT = Layout(
    read,
    "exported ScanNet scan: color/, depth/, pose/, intrinsic/",
    {"depth": DEPTH_OPTION},
)
