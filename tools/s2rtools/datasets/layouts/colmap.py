"""Recordings as a COLMAP model, text or binary, with the folder of its images.

Poses are stored from the world to the camera, in the camera's axes x right, y down, z forward.
COLMAP leaves the scale of its world open.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    ReadOptions,
    RecordedTrajectory,
    Recording,
    existing_folder,
    folder_name,
    natural_order,
    trajectory_name,
)
from s2rtools.datasets.recordings.colmap_model import ModelImage, holds_model, read_model
from s2rtools.datasets.recordings.recorded_cameras import CAMERA_ID, choose_camera
from s2rtools.datasets.recordings.recorded_files import FrameFiles
from s2rtools.datasets.recordings.recorded_poses import poses_from_quaternions
from s2rtools.datasets.scan import choose_trajectories

_MODEL_FOLDERS = (".", "sparse", "colmap/sparse")
_LEVELS = 4
"""Folders above a model, with itself, in which `images` is looked for."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read the model in `path`, or in its folder `sparse` or `sparse/0`.

    Images are sorted by name; those of each subfolder are a trajectory. Raises RequestError if the
    model or its images are missing or damaged, if it has several cameras and the option chooses
    none, or if no image is usable.
    """
    folder = _find_model(path)
    model = read_model(folder)
    recording = Recording.of_folder(
        "colmap", _image_folder(folder, options.values.get("images")), options
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
    parts: dict[str, list[tuple[ModelImage, str | None]]] = {}
    folders: dict[str, str] = {}
    for image in sorted(images, key=lambda image: natural_order(image.name)):
        if recording.containment.find_file(image.name, str(folder)) is None:
            recording.report("missing image", image.name)
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
        parts.setdefault(name, []).append((image, depth_name))
    if not parts:
        raise RequestError(
            f"{recording.root}: none of the model's images; name their folder, images=FOLDER"
        )
    for name in choose_trajectories(options.trajectories, parts, folder):
        recording.trajectories[name] = _trajectory(parts[name], recording, scale)
    recording.provenance = {
        "model": str(folder),
        "cameras": remark or ", ".join(sorted(used)),
        "world_units_to_metres": scale,
    }
    return recording


def _trajectory(
    images: list[tuple[ModelImage, str | None]], recording: Recording, scale: float
) -> RecordedTrajectory:
    """Frames with poses from the camera to the world, positions times `scale`."""
    files = FrameFiles(recording.root)
    files.size = recording.camera.height, recording.camera.width
    for image, depth_name in images:
        files.append(image.name, depth_name)
    w, x, y, z = np.array([image.quaternion for image, _ in images]).T
    translations = np.array([image.translation for image, _ in images])
    poses = poses_from_quaternions(translations, np.column_stack([x, y, z, w]))
    inverse = np.swapaxes(poses[:, :3, :3], 1, 2).copy()
    with np.errstate(over="ignore", invalid="ignore"):
        poses[:, :3, 3] = -scale * np.einsum("nij,nj->ni", inverse, translations)
    poses[:, :3, :3] = inverse
    return RecordedTrajectory(files.frames(), poses, np.full(len(files), np.nan))


def _depth_folder(options: ReadOptions, recording: Recording) -> PathContainment | None:
    """The folder that the option `depth` names."""
    folder = options.values.get("depth")
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


def _find_model(path: Path) -> Path:
    found = list(_models(existing_folder(path)))
    if not found:
        raise RequestError(f"{path}: no cameras.txt with images.txt (or .bin) in it or in sparse/0")
    if len(found) > 1:
        names = ", ".join(str(each) for each in found[:8])
        raise RequestError(f"{path}: several models; give the path of one of {names}")
    return found[0]


def _models(path: Path) -> Iterator[Path]:
    for name in _MODEL_FOLDERS:
        folder = path / name
        if holds_model(folder):
            yield folder
            return
        if name != "." and folder.is_dir():
            found = [each for each in sorted(folder.iterdir()) if holds_model(each)]
            if found:
                yield from found
                return


def _image_folder(model: Path, option: str | None) -> Path:
    if option is not None:
        if not Path(option).is_dir():
            raise RequestError(f"option images={option}: no such folder")
        return Path(option)
    folders = [model.resolve(), *model.resolve().parents][:_LEVELS]
    for folder in folders:
        if (folder / "images").is_dir():
            return folder / "images"
    raise RequestError(f"{model}: no folder `images` beside the model; name it, images=FOLDER")


LAYOUT = Layout(
    read,
    "COLMAP model, text or binary",
    {
        "scale": "metres per unit of the world; without it, poses are not metric",
        "images": "folder of the images, by default the folder `images` beside the model",
        "depth": "folder of depth images with the names of the images",
        "depth_scale": "metres per unit of depth, by default 0.001",
        CAMERA_ID: "number of the camera whose images are read, if there are several, or `median`",
    },
)
