"""Recordings as a COLMAP model, text or binary, with the folder of its images.

Poses are stored from the world to the camera, in the camera's axes x right, y down, z forward.
COLMAP leaves the scale of its world open.
"""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath

from s2rstore.errors import RequestError
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    ReadOptions,
    Recording,
    folder_name,
    natural_order,
    trajectory_name,
)
from s2rtools.datasets.recordings.colmap_model import (
    camera_poses,
    find_images,
    find_model,
    read_model,
)
from s2rtools.datasets.recordings.frame_table import FrameTable
from s2rtools.datasets.recordings.stated_cameras import CAMERA_ID, choose_camera


def read(path: Path, options: ReadOptions) -> Recording:
    """Read the model in `path`, or in its folder `sparse` or `sparse/0`.

    Images are sorted by name; those of each subfolder are a trajectory. Raises RequestError if the
    model or its images are missing or damaged, if it has several cameras and the option chooses
    none, or if no image is usable.
    """
    folder = find_model(path)
    model = read_model(folder)
    recording = Recording.of_folder(
        "colmap", find_images(folder, options.values.get("images")), options
    )
    recording.name = folder_name(path)
    named = {str(number): camera for number, camera in model.cameras.items()}
    cameras, option = [str(image.camera) for image in model.images], options.values.get(CAMERA_ID)
    recording.camera, used, remark = choose_camera(named, cameras, option, folder)
    if remark:
        recording.report("several cameras", str(folder), remark)
    scale = recording.state_scale(options)
    recording.depth_scale = options.positive("depth_scale", recording.depth_scale)
    images = [image for image in model.images if str(image.camera) in used]
    depth = _depth_folder(options, recording)
    table, folders = FrameTable(recording), dict[str, str]()
    table.size = recording.camera.height, recording.camera.width
    for image in sorted(images, key=lambda image: natural_order(image.name)):
        if recording.containment.find_file(image.name, str(folder)) is None:
            recording.report("missing image", image.name or str(folder))
            continue
        depth_name = None if depth is None else _depth_name(depth, image.name, recording)
        if depth is not None and depth_name is None:
            recording.report("no depth image", image.name, str(depth.folder))
            continue
        parent = str(PurePosixPath(image.name).parent)
        name = trajectory_name(recording.name if parent == "." else parent)
        if folders.setdefault(name, parent) != parent:
            raise RequestError(
                f"{recording.root}: folders {folders[name]!r} and {parent!r} would both be "
                f"trajectory {name}"
            )
        pose = *image.quaternion, *image.translation
        table.add(image.name, depth_name, pose, trajectory=name)
    if not len(table):
        raise RequestError(
            f"{recording.root}: none of the model's images; name their folder, images=FOLDER"
        )
    table.fill(lambda values: camera_poses(values, scale))
    recording.provenance = {
        "model": str(folder),
        "cameras": remark or ", ".join(sorted(used)),
        "world_units_to_metres": scale,
    }
    return recording


def _depth_folder(options: ReadOptions, recording: Recording) -> PathContainment | None:
    """The folder that the option `depth` names."""
    folder = options.named_depth
    if folder is None:
        return None
    if not Path(folder).is_dir():
        raise RequestError(f"option depth={folder}: no such folder")
    return recording.containment.for_folder(Path(folder))


def _depth_name(depth: PathContainment, name: str, recording: Recording) -> str | None:
    """The depth image of the name of an RGB image, or its stem and `.png`; None without one.

    It is a path relative to the RGB images.
    """
    for candidate in (name, str(PurePosixPath(name).with_suffix(".png"))):
        if (path := depth.find_file(candidate, str(depth.folder))) is not None:
            relative = os.path.relpath(os.path.realpath(path), os.path.realpath(recording.root))
            return Path(relative).as_posix()
    return None


LAYOUT = Layout(
    read,
    "COLMAP model, text or binary",
    {
        "scale": "metres per unit of the world; without it, poses are not metric",
        "images": "folder of the images, by default the folder `images` beside the model",
        "depth": "folder of depth images with the names of the images, by default none",
        "depth_scale": "metres per unit of depth, by default 0.001",
        CAMERA_ID: "number of the camera whose images are read, if there are several, or `median`",
    },
)
