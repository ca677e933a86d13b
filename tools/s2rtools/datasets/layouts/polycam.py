"""Polycam's raw data export: `keyframes/{images,cameras,depth}`, one file of each per image.

Files of one image have one name, its time in microseconds. `cameras/N.json` holds the intrinsics in
pixels of images of `width` x `height`, and the pose `t_RC` (row, column) from ARKit's axes of the
camera (x right, y up, z backward) to a world whose y points up, metres. Poses that Polycam has
optimised are in `corrected_cameras`, for the undistorted images in `corrected_images`; those of
ARKit, for images with the distortion of the lens, are read where these are missing. Depth is in
millimetres, of the same field of view and fewer pixels, and may be absent.

The focal length follows the autofocus: the camera of a recording is the median of all images. Where
the centre of the first pixel is, the export does not state; pixel i is taken to cover [i, i + 1).

Source: the section "Polycam's data format" of the documentation of polyform, Polycam's own tool.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.documents import decode_json
from s2rstore.files.input_files import read_bytes
from s2rtools.datasets.recording import (
    DEPTH_OPTION,
    Layout,
    PinholeCamera,
    ReadOptions,
    Recording,
)
from s2rtools.datasets.recordings.frame_table import FrameTable, matrices
from s2rtools.datasets.recordings.recorded_files import NumberedFiles
from s2rtools.datasets.recordings.stated_cameras import CAMERA_ID, MEDIAN, image_size

_IMAGE = re.compile(r"([0-9]+)\.(?:jpg|jpeg|png)", re.IGNORECASE)
_MAX_BYTES = 64 << 10
_MICROSECONDS = 1e6
_PREFIXES = {"corrected": "corrected_", "arkit": ""}
_TO_OPENCV = np.array([1.0, -1.0, -1.0, 1.0])
"""Signs of a pose's columns in axes x right, y down, z forward."""


_POSE = [f"t_{row}{column}" for row in range(3) for column in range(4)]
_Camera = msgspec.defstruct(
    "_Camera",
    [("width", int), ("height", int)]
    + [(name, float) for name in ("fx", "fy", "cx", "cy", *_POSE)],
)
"""A file of the folder `cameras`."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read the folder that holds `keyframes`. Raises RequestError if `path` is none."""
    recording = Recording.of_folder("polycam", path, options)
    is_corrected = (path / "keyframes/corrected_cameras").is_dir()
    poses_of = options.values.get("poses", "corrected" if is_corrected else "arkit")
    if poses_of not in _PREFIXES:
        raise RequestError(f"option poses={poses_of}: choose from {', '.join(_PREFIXES)}")
    images, cameras = (f"keyframes/{_PREFIXES[poses_of]}{kind}/" for kind in ("images", "cameras"))
    has_depth = options.reads_depth and (path / "keyframes/depth").is_dir()
    table = FrameTable(recording)
    listed = NumberedFiles(path / images, _IMAGE)
    for number in listed.numbers.tolist():
        rgb = f"{images}{listed.name(number)}"
        depth = f"keyframes/depth/{Path(rgb).stem}.png"
        if has_depth and recording.containment.find_file(depth, str(path)) is None:
            recording.report("no depth image", rgb)
        elif recording.has_image(rgb) and (found := _camera(recording, cameras, rgb)):
            width, height, fx, fy, cx, cy, *pose = found
            table.add(
                rgb,
                depth if has_depth else None,
                (*pose, 0.0, 0.0, 0.0, 1.0),
                number / _MICROSECONDS,
                camera=PinholeCamera(width, height, fx, fy, cx, cy),
            )
    remark = table.choose_camera(options, path, MEDIAN)
    table.fill(lambda values: matrices(values) * _TO_OPENCV)
    if has_depth:
        depth_size = image_size(recording, depth=True)
        recording.depth_camera = recording.camera.checked(str(path)).resized(depth_size)
    recording.up = (0.0, 1.0, 0.0)
    recording.provenance = {"poses": poses_of, "cameras": remark or "one"}
    return recording


def _camera(recording: Recording, folder: str, image: str) -> tuple[Any, ...]:
    """The numbers of an image's camera, in their order; none where they cannot be read."""
    name = f"{folder}{Path(image).stem}.json"
    path = recording.resolve(name)
    try:
        return msgspec.structs.astuple(decode_json(read_bytes(path, _MAX_BYTES), _Camera, name))
    except RequestError as error:
        recording.report("no pose", image, str(error).removeprefix(f"{path}: "))
        return ()


LAYOUT = Layout(
    read,
    "raw data export of Polycam: keyframes/images, cameras, depth",
    {
        "poses": "corrected (optimised, the default where they are there) or arkit",
        "depth": DEPTH_OPTION,
        CAMERA_ID: f"number of the camera whose images are read, or `{MEDIAN}` (default)",
    },
)
