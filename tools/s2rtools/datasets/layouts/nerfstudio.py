"""Recordings as `transforms.json` of nerfstudio and instant-ngp, with the images beside it.

`transform_matrix` maps points from the camera's axes of OpenGL (x right, y up, z backward) to the
world. `applied_transform` and `applied_scale`, which nerfstudio's own tools write, are undone:
poses are those of the original data. A file lists its frames in any order: they are sorted by
`timestamp` or `time` where all frames state it, else by the names of their images. Pixel i covers
[i, i + 1), so that intrinsics need no conversion. Depth images hold whole numbers; times
`depth_unit_scale_factor` (nerfstudio) or `integer_depth_scale` (instant-ngp) they are units of the
world.
"""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.common.image_files import SUFFIXES
from s2rtools.common.lazy_sequence import chosen
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
    existing_folder,
    folder_name,
    trajectory_name,
)
from s2rtools.datasets.recordings.recorded_cameras import CAMERA_ID, choose_camera
from s2rtools.datasets.recordings.recorded_files import FrameFiles
from s2rtools.datasets.recordings.transforms_file import Intrinsics, read_transforms
from s2rtools.datasets.scan import choose_trajectories


def read(path: Path, options: ReadOptions) -> Recording:
    """Read one file, or the folder of `transforms.json` or of several `transforms_*.json`.

    Each of several files is a trajectory. Raises RequestError if a file is missing or damaged, has
    cameras that the option does not choose from, or no usable frame.
    """
    if path.suffix and not path.exists():
        raise RequestError(f"{path}: no such file or folder")
    if path.is_file() and path.suffix.lower() != ".json":
        raise RequestError(f"{path}: not a JSON file; name transforms.json or its folder")
    files = {trajectory_name(path.stem): path} if path.is_file() else _files_in(path)
    root = path.parent if path.is_file() else path
    recording = Recording.of_folder("nerfstudio", root, options)
    parts = {
        name: _Part(recording, files[name])
        for name in choose_trajectories(options.trajectories, files, path)
    }
    names: dict[PinholeCamera, str] = {}
    images = [
        names.setdefault(camera, str(len(names) + 1))
        for part in parts.values()
        for camera in part.cameras
    ]
    if not images:
        recording.require_frames()
    by_name = {name: camera for camera, name in names.items()}
    option = options.values.get(CAMERA_ID)
    recording.camera, used, remark = choose_camera(by_name, images, option, path)
    if remark:
        recording.report("several cameras", path.name, remark)
    scale = recording.state_scale(options)
    recording.depth_in_world_units = "depth_scale" not in options.values
    units = {part.document.depth_unit for part in parts.values() if part.document.has_depth}
    if len(units) > 1 and recording.depth_in_world_units:
        raise RequestError(f"{path}: its files have different units of depth; set depth_scale")
    recording.depth_scale = options.positive("depth_scale", max(units, default=1e-3) * scale)
    for name, part in parts.items():
        kept = [row for row, camera in enumerate(part.cameras) if names[camera] in used]
        poses = part.document.poses([part.numbers[row] for row in kept], part.path)
        poses[:, :3, 3] *= scale
        part.files.size = recording.camera.height, recording.camera.width
        recording.trajectories[name] = RecordedTrajectory(
            chosen(part.files.frames(), kept), poses, np.full(len(kept), np.nan)
        )
    recording.provenance = {"cameras": remark or "one", "world_units_to_metres": scale}
    return recording


class _Part:
    """The frames of one file whose images exist, in recording order: `numbers` in the file."""

    def __init__(self, recording: Recording, path: Path) -> None:
        self.path, self.document = path, read_transforms(path)
        self.numbers: list[int] = []
        self.files = FrameFiles(recording.root)
        self.cameras: list[PinholeCamera] = []
        sizes: dict[Intrinsics, tuple[int, int]] = {}
        for number in self.document.recording_order():
            self._add(recording, number, sizes)

    def _add(
        self, recording: Recording, number: int, sizes: dict[Intrinsics, tuple[int, int]]
    ) -> None:
        document = self.document
        frame, where = document.frames[number], f"{self.path}: frame {number + 1}"
        rgb, depth = _find_image(recording, frame.file_path, where), None
        if rgb is None:
            recording.report("missing image", frame.file_path)
            return
        if document.has_depth:
            name = frame.depth_name
            depth = recording.containment.find_file(name, where) if name else None
            if depth is None:
                recording.report("no depth image", frame.file_path, name or "no depth_file_path")
                return
        names = [
            None if each is None else Path(os.path.relpath(each, recording.root)).as_posix()
            for each in (rgb, depth)
        ]
        self.cameras.append(document.camera(frame, rgb, sizes, where))
        self.numbers.append(number)
        self.files.append(str(names[0]), names[1])


def _find_image(recording: Recording, name: str, where: str) -> Path | None:
    """The image's path; files of the original NeRF data sets are named without their suffix."""
    has_suffix = PurePosixPath(name).suffix.lower() in SUFFIXES
    names = [name] if has_suffix else [name, *(name + suffix for suffix in SUFFIXES)]
    found = (recording.containment.find_file(each, where) for each in names)
    return next((path for path in found if path is not None), None)


def _files_in(folder: Path) -> dict[str, Path]:
    if (folder / "transforms.json").is_file():
        return {trajectory_name(folder_name(folder)): folder / "transforms.json"}
    found = sorted(existing_folder(folder).glob("transforms_*.json"))
    if not found:
        raise RequestError(f"{folder}: no transforms.json in it")
    return {trajectory_name(path.stem.removeprefix("transforms_")): path for path in found}


LAYOUT = Layout(
    read,
    "transforms.json of nerfstudio and instant-ngp",
    {
        "scale": "metres per unit of the world; without it, poses are not metric",
        "depth_scale": "metres per unit of depth, instead of the file's",
        CAMERA_ID: "the camera whose images are read, if there are several, or `median`",
    },
)
