"""Recordings as ROS bags: ROS 1 `.bag`, ROS 2 folders, their `.db3` files, and `.mcap` files.

Images are raw or compressed; poses come from a topic of odometry or poses, or from the transforms
`/tf` and `/tf_static`, and are interpolated at the times of the RGB images. Poses of another frame
than the camera's are moved to it by the transforms. Worlds of the frames `map`, `odom` and `world`
have z up (REP 103, REP 105).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.common.bag_files import BAG_SUFFIXES, refusing_damage
from s2rtools.datasets.bags.bag_part import SCALE, TOLERANCE, BagPart
from s2rtools.datasets.bags.camera_poses import FORWARD, MAX_GAP, OPTICAL
from s2rtools.datasets.recording import (
    Layout,
    ReadOptions,
    Recording,
    existing_folder,
    folder_name,
    trajectory_name,
)
from s2rtools.datasets.recordings.stated_cameras import CAMERA_OPTION
from s2rtools.datasets.scan import choose_trajectories

_LEVEL_WORLDS = ("map", "odom", "world")
_FIXED_WORLDS = ("map", "world")
"""Frames whose axes do not depend on where a recording starts."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read one bag, or a folder of bags, each a trajectory.

    Every bag is read once from its start to its end; images are decoded later. Raises RequestError
    if a bag is damaged, if topics, frames or the camera are missing or ambiguous, if the bags have
    different cameras, or if no image has a pose.
    """
    bags = _bags(path)
    recording = Recording("bag", folder_name(path), path)
    parts = []
    for name in choose_trajectories(options.trajectories, bags, path):
        with refusing_damage(bags[name]):
            parts.append((name, BagPart(bags[name], options, recording)))
    first = parts[0][1]
    recording.camera, recording.depth_camera = first.camera, first.depth_camera
    recording.depth_scale = options.positive(SCALE, 0.001)
    for name, part in parts:
        if (part.camera, part.depth_camera) != (first.camera, first.depth_camera):
            raise RequestError(f"{part.bag.path}: another camera than in {first.bag.path.name}")
        with refusing_damage(part.bag.path):
            recording.trajectories[name] = part.trajectory()
        recording.provenance[name] = part.facts
    worlds = {part.world for name, part in parts if len(recording.trajectories[name].frames)}
    recording.has_own_worlds = len(worlds) != 1 or not worlds.issubset(_FIXED_WORLDS)
    if all(part.world in _LEVEL_WORLDS for _, part in parts):
        recording.up = (0.0, 0.0, 1.0)
    return recording


def _bags(path: Path) -> dict[str, Path]:
    """The bags that a path stands for, by the names of their trajectories."""
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return {trajectory_name(_stem(path)): path}
    found = list(_bags_in(existing_folder(path)))
    bags = {trajectory_name(_stem(each)): each for each in found}
    if not bags:
        raise RequestError(f"{path}: no bag in it ({', '.join(BAG_SUFFIXES)} or metadata.yaml)")
    if len(bags) < len(found):
        raise RequestError(f"{path}: two bags would be trajectories of one name; rename one")
    return bags


def _stem(path: Path) -> str:
    return folder_name(path) if path.is_dir() else path.stem


def _bags_in(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in BAG_SUFFIXES or (path / "metadata.yaml").is_file():
            yield path


LAYOUT = Layout(
    read,
    "ROS 1 and ROS 2 bags and MCAP files",
    {
        "rgb": "topic of the RGB images",
        "depth": "topic of the depth images, or `none`",
        "info": "topic of the RGB camera's CameraInfo",
        "camera": f"instead of CameraInfo: {CAMERA_OPTION}",
        "pose": "topic of the poses, or `tf` for the transforms",
        "body": "frame that the poses are of, by default child_frame_id or the camera's",
        "frame": "frame of the camera, by default that of the RGB images",
        "world": "frame of the world with pose=tf, by default the root of the transforms",
        "axes": f"of the camera's frame: {OPTICAL} (z forward, the default) or {FORWARD} (x)",
        "gap": f"longest time in seconds between interpolated poses, by default {MAX_GAP}",
        "tolerance": f"longest time in seconds from RGB to depth, by default {TOLERANCE}",
        SCALE: "metres per unit of 16-bit depth, by default 0.001",
    },
)
