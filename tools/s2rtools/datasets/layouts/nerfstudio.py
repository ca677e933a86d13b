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
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import (
    DEPTH_OPTION,
    Layout,
    ReadOptions,
    Recording,
    existing_folder,
    folder_name,
    trajectory_name,
)
from s2rtools.datasets.recordings.frame_table import FrameTable
from s2rtools.datasets.recordings.stated_cameras import CAMERA_ID
from s2rtools.datasets.recordings.transforms_file import (
    Intrinsics,
    Transforms,
    find_image,
    read_transforms,
)
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
        name: read_transforms(files[name])
        for name in choose_trajectories(options.trajectories, files, path)
    }
    table, scale = FrameTable(recording, list(parts)), recording.state_scale(options)
    for name, document in parts.items():
        _add_frames(table, name, document, files[name], options)
    remark = table.choose_camera(options, path)
    if remark:
        recording.report("several cameras", path.name, remark)
    recording.depth_in_world_units = "depth_scale" not in options.values
    units = {document.depth_unit for document in parts.values() if document.has_depth}
    if len(units) > 1 and recording.depth_in_world_units:
        raise RequestError(f"{path}: its files have different units of depth; set depth_scale")
    recording.depth_scale = options.positive("depth_scale", max(units, default=1e-3) * scale)
    table.size = recording.camera.height, recording.camera.width
    table.fill()
    recording.provenance = {"cameras": remark or "one", "world_units_to_metres": scale}
    return recording


def _add_frames(
    table: FrameTable, name: str, document: Transforms, path: Path, options: ReadOptions
) -> None:
    """Add the frames of one file whose images exist as trajectory `name`, in recording order."""
    recording, order = table.recording, document.recording_order()
    poses = document.poses(order, path)
    poses[:, :3, 3] *= options.positive("scale", 1.0)
    reads_depth = options.reads_depth and document.has_depth
    sizes: dict[Intrinsics, tuple[int, int]] = {}
    for number, pose in zip(order, poses, strict=True):
        frame, where = document.frames[number], f"{path}: frame {number + 1}"
        rgb, depth = find_image(recording.containment, frame.file_path, where), None
        if rgb is None:
            recording.report("missing image", frame.file_path or where)
            continue
        if reads_depth:
            depth = recording.containment.find_file(frame.depth_name or "", where)
            if depth is None:
                detail = frame.depth_name or "no depth_file_path"
                recording.report("no depth image", frame.file_path, detail)
                continue
        image, depth_image = (
            None if each is None else Path(os.path.relpath(each, recording.root)).as_posix()
            for each in (rgb, depth)
        )
        camera = document.camera(frame, rgb, sizes, where)
        table.add(str(image), depth_image, pose.ravel(), trajectory=name, camera=camera)


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
        "depth": DEPTH_OPTION,
        "depth_scale": "metres per unit of depth, instead of the file's",
        CAMERA_ID: "the camera whose images are read, if there are several, or `median`",
    },
)
