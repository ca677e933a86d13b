"""Recordings as a COLMAP model, text or binary, with the folder of its images.

Poses are stored from the world to the camera, in the camera's axes x right, y down, z forward.
COLMAP leaves the scale of its world open.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import Layout, ReadOptions, RecordedTrajectory, Recording
from s2rtools.datasets.recordings.colmap_model import ModelImage, holds_model, read_model
from s2rtools.datasets.recordings.recorded_cameras import CAMERA_ID, choose_camera
from s2rtools.datasets.recordings.recorded_files import FrameFiles
from s2rtools.datasets.recordings.recorded_folders import (
    folder_name,
    natural_order,
    require_frames,
    trajectory_name,
)
from s2rtools.datasets.recordings.recorded_poses import (
    orthonormal,
    poses_from_quaternions,
    report_unusable,
)
from s2rtools.datasets.scan import choose_trajectories

_MODEL_FOLDERS = (".", "sparse", "colmap/sparse")
_LEVELS = 4
"""Folders above a model, with itself, in which `images` is looked for."""


def read_colmap(path: Path, options: ReadOptions) -> Recording:
    """Read the model in `path`, or in its folder `sparse` or `sparse/0`.

    Images are sorted by name; those of each subfolder are a trajectory. Raises RequestError if the
    model or its images are missing or damaged, if it has several cameras and the option chooses
    none, or if no image is usable.
    """
    folder = _find_model(path)
    model = read_model(folder)
    root = _image_folder(folder, options.values.get("images"))
    containment = PathContainment(root, options.allow_outside)
    named = {str(number): camera for number, camera in model.cameras.items()}
    camera, chosen, remark = choose_camera(
        named, [str(image.camera) for image in model.images], options.values.get(CAMERA_ID), folder
    )
    recording = Recording("colmap", folder_name(path), root, camera)
    if remark:
        recording.issues.append(InputIssue("several cameras", str(folder), remark))
    scale = options.positive("scale", 1.0)
    recording.is_metric = "scale" in options.values
    recording.scale_option = "scale"
    recording.depth_scale = options.positive("depth_scale", recording.depth_scale)
    depth = _DepthFolder(options.values.get("depth"), containment)
    by_trajectory: dict[str, list[tuple[ModelImage, str | None]]] = {}
    folders: dict[str, str] = {}
    for image in sorted(model.images, key=lambda image: natural_order(image.name)):
        if str(image.camera) not in chosen:
            continue
        if containment.find_file(image.name, str(folder)) is None:
            recording.issues.append(InputIssue("missing image", image.name))
            continue
        depth_name = depth.name_for(image.name)
        if depth.folder is not None and depth_name is None:
            recording.issues.append(InputIssue("no depth image", image.name, str(depth.folder)))
            continue
        parent = str(PurePosixPath(image.name).parent)
        name = trajectory_name(folder_name(path) if parent == "." else parent)
        if folders.setdefault(name, parent) != parent:
            raise RequestError(
                f"{root}: folders {folders[name]!r} and {parent!r} would both be trajectory {name}"
            )
        by_trajectory.setdefault(name, []).append((image, depth_name))
    if not by_trajectory:
        raise RequestError(f"{root}: none of the model's images; name their folder, images=FOLDER")
    for name in choose_trajectories(options.trajectories, by_trajectory, folder):
        trajectory = _trajectory(by_trajectory[name], recording, scale)
        if len(trajectory.frames):
            recording.trajectories[name] = trajectory
    require_frames("colmap", path, recording.trajectories, recording.issues)
    recording.outside_folders = containment.outside_folders
    recording.provenance = {
        "model": str(folder),
        "cameras": remark or ", ".join(sorted(chosen)),
        "world_units_to_metres": scale,
    }
    return recording


def _trajectory(
    images: list[tuple[ModelImage, str | None]], recording: Recording, scale: float
) -> RecordedTrajectory:
    """The images with usable poses; the others are reported."""
    files = FrameFiles(recording.root)
    files.size = recording.camera.height, recording.camera.width
    for image, depth_name in images:
        files.append(image.name, depth_name)
    w, x, y, z = np.array([image.quaternion for image, _ in images]).T
    quaternions = np.column_stack([x, y, z, w])
    translations = np.array([image.translation for image, _ in images])
    poses = _poses(translations, quaternions, scale)
    usable = report_unusable(poses, lambda row: images[row][0].name, recording.issues, quaternions)
    frames = files.chosen(np.flatnonzero(usable).tolist())
    return RecordedTrajectory(frames, orthonormal(poses[usable]), np.full(len(frames), np.nan))


def _poses(
    translations: NDArray[np.float64], quaternions: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    """Poses (N, 4, 4) from the camera to the world, positions times `scale`; NaN if unusable."""
    poses = poses_from_quaternions(translations, quaternions)
    inverse = np.swapaxes(poses[:, :3, :3], 1, 2).copy()
    poses[:, :3, 3] = -scale * np.einsum("nij,nj->ni", inverse, translations)
    poses[:, :3, :3] = inverse
    return poses


class _DepthFolder:
    """Depth images that have the names of the RGB images, or their stems and `.png`."""

    def __init__(self, folder: str | None, containment: PathContainment) -> None:
        self.folder = None if folder is None else Path(folder)
        if self.folder is not None and not self.folder.is_dir():
            raise RequestError(f"option depth={folder}: no such folder")
        self._root = containment.folder
        if self.folder is not None:
            self._containment = containment.for_folder(self.folder)

    def name_for(self, name: str) -> str | None:
        """The depth image's path relative to the RGB images; None without one."""
        if self.folder is None:
            return None
        for candidate in (name, str(PurePosixPath(name).with_suffix(".png"))):
            path = self._containment.find_file(candidate, str(self.folder))
            if path is not None:
                relative = os.path.relpath(os.path.realpath(path), os.path.realpath(self._root))
                return Path(relative).as_posix()
        return None


def _find_model(path: Path) -> Path:
    if not path.is_dir():
        raise RequestError(f"{path}: no such folder")
    found = list(_models(path))
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
    read_colmap,
    "COLMAP model, text or binary",
    {
        "scale": "metres per unit of the world; without it, poses are not metric",
        "images": "folder of the images, by default the folder `images` beside the model",
        "depth": "folder of depth images with the names of the images",
        "depth_scale": "metres per unit of depth, by default 0.001",
        CAMERA_ID: "number of the camera whose images are read, if there are several, or `median`",
    },
)
