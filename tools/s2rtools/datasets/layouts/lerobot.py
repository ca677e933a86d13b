"""Recordings as LeRobot data sets of versions 2 and 3, read without network.

The format knows neither the pose nor the intrinsics of a camera: the option `pose` names the
entries of `observation.state` that are the robot's pose on the floor, or the camera's pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import Layout, ReadOptions, RecordedTrajectory, Recording
from s2rtools.datasets.recordings.lerobot_files import (
    STATE,
    Episode,
    FrameNumbers,
    episodes_of,
    read_info,
)
from s2rtools.datasets.recordings.lerobot_images import FeatureImages
from s2rtools.datasets.recordings.recorded_poses import level_poses, poses_from_quaternions
from s2rtools.datasets.recordings.stated_cameras import CAMERA_OPTION, camera_option
from s2rtools.datasets.recordings.video_images import frames_of
from s2rtools.datasets.scan import choose_trajectories


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a data set's folder; each episode is a trajectory.

    Raises RequestError if a file is missing or damaged, if an option is missing, if the videos
    cannot be decoded, or if no frame has a pose.
    """
    recording = Recording.of_folder("lerobot", path, options)
    info = read_info(path)
    key = info.image_key(path, options.values.get("rgb"))
    depth = info.depth_key(path, key, options.values.get("depth"))
    keys = [key] if depth is None else [key, depth]
    entries = info.pose_entries(path, options.values.get("pose"))
    episodes = {f"episode_{each.number:06d}": each for each in episodes_of(path, info, keys)}
    names = choose_trajectories(options.trajectories, episodes, path)
    if not names:
        raise RequestError(f"{path}: no episodes in it")
    data = FrameNumbers(recording.containment, entries)
    first, containment = episodes[names[0]], recording.containment
    streams = [FeatureImages.of(containment, info, each, first, data) for each in keys]
    size = streams[0].size
    camera = camera_option(options, "camera", size)
    if camera is None:
        raise RequestError(f"{path}: a LeRobot data set has no intrinsics; set camera=fx,fy,cx,cy")
    if (camera.height, camera.width) != size:
        raise RequestError(f"{path}: images are {size[1]}x{size[0]}, unlike the option camera")
    recording.camera = camera
    recording.depth_camera = camera_option(options, "depth_camera", streams[-1].size)
    if depth is not None and recording.depth_camera is None and streams[1].size != size:
        raise RequestError(f"{path}: depth has another size than images; set depth_camera=")
    height = options.positive("height", 1.0) if "height" in options.values else 0.0
    if len(entries) == 3:
        recording.up = (0.0, 0.0, 1.0)
        if "height" not in options.values:
            detail = "the camera is put on the floor; set height=METRES"
            recording.report("height unknown", str(path), detail)
    for name in names:
        recording.trajectories[name] = _trajectory(episodes[name], data, streams, height)
    feature = info.features[key]
    recording.provenance = {
        "version": info.codebase_version,
        "images": key,
        "depth": depth or "none",
        "codec": feature.codec if feature.dtype == "video" else "images",
        "pose": options.values["pose"],
        "height_m": height,
    }
    return recording


def _trajectory(
    episode: Episode, data: FrameNumbers, streams: Sequence[FeatureImages], height: float
) -> RecordedTrajectory:
    """An episode; states are x, y, heading of the robot, or the pose of the camera."""
    rows = data.rows(episode)
    states = data.state(rows)
    is_level = states.shape[1] == 3
    poses = (
        level_poses(states, height)
        if is_level
        else poses_from_quaternions(states[:, :3], states[:, 3:])
    )
    frames = frames_of([stream.stream(episode, data, rows) for stream in streams])
    return RecordedTrajectory(frames, poses, data.numbers("timestamp", rows))


LAYOUT = Layout(
    read,
    "LeRobot data set of version 2 or 3",
    {
        "pose": f"entries of {STATE}: x,y,heading in radians, or x,y,z,qx,qy,qz,qw of the camera",
        "height": "metres of the camera above the floor with pose=x,y,heading",
        "rgb": "feature of the images, if there are several",
        "depth": "feature of the depth images, if it is not evident; none: colour images alone",
        "camera": CAMERA_OPTION,
        "depth_camera": f"of depth images of another size: {CAMERA_OPTION}",
    },
)
