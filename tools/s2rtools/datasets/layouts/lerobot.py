"""Recordings as LeRobot data sets of versions 2 and 3, read without network.

The format knows neither the pose nor the intrinsics of a camera: the option `pose` names the
entries of `observation.state` that are the robot's pose on the floor, or the camera's pose.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.index.parquet_table import read_columns, read_vectors
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.lazy_sequence import LazySequence
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    ReadOptions,
    RecordedFrame,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.lerobot_files import (
    MAX_NUMBER,
    Episode,
    ImageStore,
    Info,
    ParquetImages,
    StoredImage,
    VideoImages,
    episodes_of,
    read_info,
)
from s2rtools.datasets.recordings.recorded_poses import (
    level_poses,
    poses_from_quaternions,
)
from s2rtools.datasets.recordings.stated_cameras import CAMERA_OPTION, camera_option
from s2rtools.datasets.scan import choose_trajectories

_STATE = "observation.state"
_NUMBERS = ("episode_index", "frame_index", "timestamp")


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a data set's folder; each episode is a trajectory.

    Raises RequestError if a file is missing or damaged, if an option is missing, if the videos
    cannot be decoded, or if no frame has a pose.
    """
    recording = Recording.of_folder("lerobot", path, options)
    info = read_info(path)
    key = _image_key(path, info, options)
    entries = _pose_entries(path, info, options)
    episodes = {f"episode_{each.number:06d}": each for each in episodes_of(path, info, key)}
    names = choose_trajectories(options.trajectories, episodes, path)
    if not names:
        raise RequestError(f"{path}: no episodes in it")
    feature, containment = info.features[key], recording.containment
    images: ImageStore = (
        VideoImages(containment, feature.codec)
        if feature.dtype == "video"
        else ParquetImages(containment, key)
    )
    data = _DataFiles(containment, entries)
    first = episodes[names[0]]
    start = first.first_frame if first.video else int(data.rows(first)[0])
    size = _first_size(path, images, first, start, feature.codec)
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


class _DataFiles:
    """Numbers of the frames of each episode; the file that was read last is kept."""

    def __init__(self, containment: PathContainment, entries: list[int]) -> None:
        self._containment, self._entries = containment, entries
        self._file: str | None = None
        self._numbers: dict[str, NDArray[np.float64]] = {}
        self._state = np.zeros((0, len(entries)))

    def rows(self, episode: Episode) -> NDArray[np.intp]:
        """Rows of the episode in its file, by frame. Raises RequestError if it has none."""
        if episode.data != self._file:
            path = self._containment.resolve(episode.data, str(self._containment.folder))
            self._numbers = read_columns(path, _NUMBERS, ())
            if missing := [name for name in _NUMBERS if name not in self._numbers]:
                raise RequestError(f"{path}: no column {missing[0]}")
            self._state = read_vectors(path, _STATE, self._entries)
            self._file = episode.data
        rows = np.flatnonzero(self._numbers["episode_index"] == episode.number)
        rows = rows[np.abs(self._numbers["frame_index"][rows]) <= MAX_NUMBER]
        if not len(rows):
            raise RequestError(f"{episode.data}: no frames of episode {episode.number}")
        return rows[np.argsort(self._numbers["frame_index"][rows], kind="stable")]

    def numbers(self, name: str, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._numbers[name][rows]

    def state(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._state[rows]


def _trajectory(
    episode: Episode, data: _DataFiles, images: ImageStore, size: tuple[int, int], height: float
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


def _image_key(path: Path, info: Info, options: ReadOptions) -> str:
    keys = [
        name
        for name, feature in info.features.items()
        if feature.dtype in ("video", "image") and not feature.is_depth
    ]
    chosen = options.values.get("rgb")
    listed = ", ".join(keys) or "none"
    if chosen is not None and chosen not in keys:
        raise RequestError(f"{path}: no images rgb={chosen} (has: {listed})")
    if chosen is None and len(keys) != 1:
        raise RequestError(f"{path}: {len(keys)} cameras; choose one with rgb= (has: {listed})")
    return chosen or keys[0]


def _pose_entries(path: Path, info: Info, options: ReadOptions) -> list[int]:
    """Numbers of the entries of the state that the option `pose` names, by name or number."""
    if _STATE not in info.features:
        raise RequestError(f"{path}: no feature {_STATE}, in which poses would be")
    feature = info.features[_STATE]
    known, count = feature.entries(), int(np.prod(feature.shape)) if feature.shape else 0
    listed = ", ".join(known) or f"0 to {count - 1}"
    text = options.values.get("pose")
    if text is None:
        raise RequestError(f"{path}: name the entries of {_STATE}, pose=x,y,theta (has: {listed})")
    entries = []
    for name in text.split(","):
        if name in known:
            entries.append(known.index(name))
        elif re.fullmatch(r"\d{1,4}", name) and int(name) < count:
            entries.append(int(name))
        else:
            raise RequestError(f"{path}: no entry {name!r} in {_STATE} (has: {listed})")
    if len(entries) not in (3, 7):
        raise RequestError(f"option pose={text}: name x,y,heading or x,y,z,qx,qy,qz,qw")
    return entries


def _first_size(
    path: Path, images: ImageStore, episode: Episode, number: int, codec: str
) -> tuple[int, int]:
    """(height, width) of an image. Raises RequestError if it cannot be decoded."""
    image = images.read(episode.video or episode.data, number)
    if isinstance(image, InputIssue):
        advice = ""
        if episode.video is not None and os.path.isfile(path / episode.video):
            advice = f"; the videos are in {codec}, convert them to H.264: ffmpeg -c:v libx264"
        raise RequestError(f"{image.file}: {image.kind} ({image.detail}){advice}")
    height, width = image.pixels.shape[:2]
    return height, width


LAYOUT = Layout(
    read,
    "LeRobot data set of version 2 or 3",
    {
        "pose": f"entries of {_STATE}: x,y,heading in radians, or x,y,z,qx,qy,qz,qw of the camera",
        "height": "metres of the camera above the floor with pose=x,y,heading",
        "rgb": "feature of the images, if there are several",
        "camera": CAMERA_OPTION,
    },
)
