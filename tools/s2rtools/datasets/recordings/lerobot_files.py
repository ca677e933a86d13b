"""Files of LeRobot data sets of versions 2 and 3: episodes, and images in videos or in Parquet.

Source: the documentation of LeRobotDataset. `meta/info.json` has the rate, the features, and the
templates of the names of files. Version 2 has a file for each episode; version 3 has several
episodes in a file, which `meta/episodes` lists.
"""

from __future__ import annotations

import hashlib
import os
import re
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import decode_json, read_bytes
from s2rstore.index.parquet_table import read_blobs, read_columns, read_vectors
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import decode_image
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import SourceImage
from s2rtools.datasets.recordings.video_images import ImageStore, VideoImages

STATE = "observation.state"
_NUMBERS = ("episode_index", "frame_index", "timestamp")
_MAX_INFO_BYTES = 8 << 20
_MAX_EPISODES = 100_000
_MAX_NUMBER = 1e12
"""Largest number of an episode, a file or a frame, and time in seconds."""
_FIELD = re.compile(r"\{(\w+)(?::0?(\d*)d)?\}")
_BLOCK = 64
"""Images that are read from Parquet at once."""


class Feature(msgspec.Struct):
    """A column or video: its type, and its entries' names, in a list or a table of lists."""

    dtype: str
    shape: list[int] = []
    names: Any = None
    info: dict[str, Any] | None = None

    @property
    def codec(self) -> str:
        return str((self.info or {}).get("video.codec", "unknown"))

    @property
    def is_depth(self) -> bool:
        return bool((self.info or {}).get("video.is_depth_map", False))

    def entries(self) -> list[str]:
        """The names of the entries, as far as they are stated."""
        names = self.names
        if isinstance(names, dict):
            names = next((each for each in names.values() if isinstance(each, list)), [])
        return [str(name) for name in names] if isinstance(names, list) else []


class Info(msgspec.Struct):
    """`meta/info.json`."""

    codebase_version: str
    fps: float
    total_episodes: int
    data_path: str
    features: dict[str, Feature]
    chunks_size: int = 1000
    video_path: str | None = None

    def image_key(self, path: Path, chosen: str | None) -> str:
        """The feature of the images, by default the only one. Raises RequestError otherwise."""
        keys = [
            name
            for name, feature in self.features.items()
            if feature.dtype in ("video", "image") and not feature.is_depth
        ]
        listed = ", ".join(keys) or "none"
        if chosen is not None and chosen not in keys:
            raise RequestError(f"{path}: no images rgb={chosen} (has: {listed})")
        if chosen is None and len(keys) != 1:
            raise RequestError(f"{path}: {len(keys)} cameras; choose one with rgb= (has: {listed})")
        return chosen or keys[0]

    def pose_entries(self, path: Path, text: str | None) -> list[int]:
        """Numbers of the entries of the state that `text` names, by name or number, 3 or 7."""
        if STATE not in self.features:
            raise RequestError(f"{path}: no feature {STATE}, in which poses would be")
        feature = self.features[STATE]
        known, count = feature.entries(), int(np.prod(feature.shape)) if feature.shape else 0
        listed = ", ".join(known) or f"0 to {count - 1}"
        if text is None:
            raise RequestError(
                f"{path}: name the entries of {STATE}, pose=x,y,theta (has: {listed})"
            )
        entries = []
        for name in text.split(","):
            if name in known:
                entries.append(known.index(name))
            elif re.fullmatch(r"\d{1,4}", name) and int(name) < count:
                entries.append(int(name))
            else:
                raise RequestError(f"{path}: no entry {name!r} in {STATE} (has: {listed})")
        if len(entries) not in (3, 7):
            raise RequestError(f"option pose={text}: name x,y,heading or x,y,z,qx,qy,qz,qw")
        return entries


@dataclass(frozen=True, slots=True)
class Episode:
    """An episode: its number, its files, and the first of its frames in the video."""

    number: int
    data: str
    video: str | None
    first_frame: int = 0


def read_info(folder: Path) -> Info:
    """Raises RequestError unless the folder holds a data set of version 2 or 3."""
    path = folder / "meta/info.json"
    info = decode_json(read_bytes(path, _MAX_INFO_BYTES), Info, str(path))
    if not info.codebase_version.startswith(("v2.", "v3.")):
        raise RequestError(f"{path}: version {info.codebase_version!r}; versions 2 and 3 are read")
    if not 0 <= info.total_episodes <= _MAX_EPISODES:
        raise RequestError(f"{path}: {info.total_episodes} episodes; at most {_MAX_EPISODES:,}")
    if not info.data_path or info.video_path == "":
        raise RequestError(f"{path}: data_path and video_path must not be empty")
    if info.chunks_size < 1 or not 0 < info.fps < 1e4:
        raise RequestError(f"{path}: chunks_size and fps must be positive")
    return info


def episodes_of(folder: Path, info: Info, image: str) -> Iterator[Episode]:
    """The episodes, with the files of the feature `image`. Raises RequestError for damage."""
    video = info.video_path if info.features[image].dtype == "video" else None
    where = folder / "meta/info.json"
    if info.codebase_version.startswith("v2."):
        for number in range(info.total_episodes):
            values: dict[str, str | int] = {
                "episode_chunk": number // info.chunks_size,
                "episode_index": number,
                "video_key": image,
            }
            yield Episode(
                number,
                _filled(info.data_path, values, where),
                None if video is None else _filled(video, values, where),
            )
        return
    for path in sorted((folder / "meta/episodes").glob("chunk-*/file-*.parquet")):
        yield from _listed_episodes(path, info, image, video)


def _listed_episodes(path: Path, info: Info, image: str, video: str | None) -> Iterator[Episode]:
    names = ["episode_index", "data/chunk_index", "data/file_index"]
    if video is not None:
        names += [f"videos/{image}/{n}" for n in ("chunk_index", "file_index", "from_timestamp")]
    columns = read_columns(path, names, ())
    if missing := [name for name in names if name not in columns]:
        raise RequestError(f"{path}: no column {missing[0]}")
    for row in np.column_stack([columns[name] for name in names]).tolist():
        if not all(abs(value) <= _MAX_NUMBER for value in row):
            raise RequestError(f"{path}: an episode without a number in {', '.join(names)}")
        data = {"chunk_index": int(row[1]), "file_index": int(row[2])}
        source = _filled(info.data_path, data, path)
        if video is None:
            yield Episode(int(row[0]), source, None)
            continue
        place: dict[str, str | int] = {"chunk_index": int(row[3]), "file_index": int(row[4])}
        filled = _filled(video, place | {"video_key": image}, path)
        yield Episode(int(row[0]), source, filled, round(row[5] * info.fps))


def _filled(template: str, values: dict[str, Any], where: Path) -> str:
    """A file name of a template with fields like `{episode_index:06d}`."""

    def text(match: re.Match[str]) -> str:
        if match[1] not in values:
            raise RequestError(f"{where}: unknown field {match[0]!r} in {template!r}")
        width = min(int(match[2] or 0), 20)
        value = values[match[1]]
        return f"{value:0{width}d}" if isinstance(value, int) else str(value)

    return _FIELD.sub(text, template)


class FrameNumbers:
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
            self._state = read_vectors(path, STATE, self._entries)
            self._file = episode.data
        rows = np.flatnonzero(self._numbers["episode_index"] == episode.number)
        rows = rows[np.abs(self._numbers["frame_index"][rows]) <= _MAX_NUMBER]
        if not len(rows):
            raise RequestError(f"{episode.data}: no frames of episode {episode.number}")
        return rows[np.argsort(self._numbers["frame_index"][rows], kind="stable")]

    def numbers(self, name: str, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._numbers[name][rows]

    def state(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._state[rows]


def first_size(
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


class ParquetImages:
    """Encoded images in a column of records with the fields `bytes` and `path`."""

    def __init__(self, containment: PathContainment, column: str) -> None:
        self._containment, self._column = containment, column
        self._lock = threading.Lock()
        self._key: tuple[str, int] = ("", -1)
        self._block: list[bytes] = []

    def read(self, file: str, number: int) -> SourceImage | InputIssue:
        name = f"{file}:{number}"
        try:
            content = self._content(file, number)
        except RequestError as error:
            return InputIssue("unreadable image", name, str(error))
        decoded = decode_image(content, name, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
        if isinstance(decoded, InputIssue):
            return decoded
        return SourceImage(decoded[0], hashlib.sha256(content).hexdigest(), decoded[1])

    def path(self, file: str) -> Path:
        """The path of a file of the data set."""
        return self._containment.folder / file

    def _content(self, file: str, number: int) -> bytes:
        key = file, number // _BLOCK
        with self._lock:
            if key != self._key:
                path = self._containment.resolve(file, str(self._containment.folder))
                start = key[1] * _BLOCK
                self._block = read_blobs(path, self._column, "bytes", start, _BLOCK)
                self._key = key
            row = number % _BLOCK
            return self._block[row] if row < len(self._block) else b""


def image_store(containment: PathContainment, key: str, feature: Feature) -> ImageStore:
    """The images of a feature `key`, which are in videos or in Parquet."""
    if feature.dtype == "video":
        return VideoImages(containment, feature.codec)
    return ParquetImages(containment, key)
