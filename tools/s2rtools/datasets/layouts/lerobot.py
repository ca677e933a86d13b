"""Recordings as LeRobot data sets of versions 2 and 3, read without network.

The format knows neither the pose nor the intrinsics of a camera: the option `pose` names the
entries of `observation.state` that are the robot's pose on the floor, or the camera's pose.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.common.lazy_sequence import LazySequence
from s2rtools.datasets.recording import (
    Layout,
    ReadOptions,
    RecordedFrame,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.lerobot_files import (
    STATE,
    Episode,
    FrameNumbers,
    episodes_of,
    first_size,
    image_store,
    read_info,
)
from s2rtools.datasets.recordings.recorded_poses import (
    level_poses,
    poses_from_quaternions,
)
from s2rtools.datasets.recordings.stated_cameras import CAMERA_OPTION, camera_option
from s2rtools.datasets.recordings.video_images import ImageStore, StoredImage
from s2rtools.datasets.scan import choose_trajectories


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a data set's folder; each episode is a trajectory.

    Raises RequestError if a file is missing or damaged, if an option is missing, if the videos
    cannot be decoded, or if no frame has a pose.
    """
    recording = Recording.of_folder("lerobot", path, options)
    info = read_info(path)
    key = info.image_key(path, options.values.get("rgb"))
    entries = info.pose_entries(path, options.values.get("pose"))
    episodes = {f"episode_{each.number:06d}": each for each in episodes_of(path, info, key)}
    names = choose_trajectories(options.trajectories, episodes, path)
    if not names:
        raise RequestError(f"{path}: no episodes in it")
    feature, containment = info.features[key], recording.containment
    images = image_store(containment, key, feature)
    data = FrameNumbers(containment, entries)
    first = episodes[names[0]]
    start = first.first_frame if first.video else int(data.rows(first)[0])
    size = first_size(path, images, first, start, feature.codec)
    camera = camera_option(options, "camera", size)
    if camera is None:
        raise RequestError(f"{path}: a LeRobot data set has no intrinsics; set camera=fx,fy,cx,cy")
    if (camera.height, camera.width) != size:
        raise RequestError(f"{path}: images are {size[1]}x{size[0]}, unlike the option camera")
    recording.camera = camera
    height = options.positive("height", 1.0) if "height" in options.values else 0.0
    if len(entries) == 3:
        recording.up = (0.0, 0.0, 1.0)
        if "height" not in options.values:
            detail = "the camera is put on the floor; set height=METRES"
            recording.report("height unknown", str(path), detail)
    for name in names:
        recording.trajectories[name] = _trajectory(episodes[name], data, images, size, height)
    recording.provenance = {
        "version": info.codebase_version,
        "images": key,
        "codec": feature.codec if feature.dtype == "video" else "images",
        "pose": options.values["pose"],
        "height_m": height,
    }
    return recording


def _trajectory(
    episode: Episode, data: FrameNumbers, images: ImageStore, size: tuple[int, int], height: float
) -> RecordedTrajectory:
    """An episode; states are x, y, heading of the robot, or the pose of the camera."""
    rows = data.rows(episode)
    file, numbers = episode.data, rows
    if episode.video is not None:
        file = episode.video
        numbers = data.numbers("frame_index", rows).astype(np.intp) + episode.first_frame

    def frame(row: int) -> RecordedFrame:
        return RecordedFrame(StoredImage(images, file, int(numbers[row]), size))

    states = data.state(rows)
    is_level = states.shape[1] == 3
    poses = (
        level_poses(states, height)
        if is_level
        else poses_from_quaternions(states[:, :3], states[:, 3:])
    )
    return RecordedTrajectory(
        LazySequence(len(rows), frame), poses, data.numbers("timestamp", rows)
    )


LAYOUT = Layout(
    read,
    "LeRobot data set of version 2 or 3",
    {
        "pose": f"entries of {STATE}: x,y,heading in radians, or x,y,z,qx,qy,qz,qw of the camera",
        "height": "metres of the camera above the floor with pose=x,y,heading",
        "rgb": "feature of the images, if there are several",
        "camera": CAMERA_OPTION,
    },
)
