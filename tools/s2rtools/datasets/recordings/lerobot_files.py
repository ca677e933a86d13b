"""Files of LeRobot data sets of versions 2 and 3: features, episodes, states and times.

Source: the documentation of LeRobotDataset. `meta/info.json` has the rate, the features, and the
templates of the names of files. Version 2 has a file for each episode; version 3 has several
episodes in a file, which `meta/episodes` lists.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.documents import decode_json
from s2rstore.files.input_files import read_bytes
from s2rstore.index.parquet_table import read_columns, read_vectors
from s2rtools.datasets.files.path_containment import PathContainment

STATE = "observation.state"
_NUMBERS = ("episode_index", "frame_index", "timestamp")
_MAX_INFO_BYTES = 8 << 20
_MAX_EPISODES = 100_000
_MAX_NUMBER = 1e12
"""Largest number of an episode, a file or a frame, and time in seconds."""
_FIELD = re.compile(r"\{(\w+)(?::0?(\d*)d)?\}")
_MAX_DEPTH = 65.0
"""Metres; depth is stored as millimetres in 16 bits."""
LAST_CODE = 4095
"""The largest code of depth in a video."""


class Feature(msgspec.Struct):
    """A column or video: its type, and its entries' names, in a list or a table of lists."""

    dtype: str
    shape: list[int] = []
    names: Any = None
    info: dict[str, Any] | None = None
    video_info: dict[str, Any] | None = None

    @property
    def facts(self) -> dict[str, Any]:
        """What is stated about images; some writers of version 2 call it `video_info`."""
        return {**(self.video_info or {}), **(self.info or {})}

    @property
    def codec(self) -> str:
        return str(self.facts.get("video.codec", "unknown"))

    @property
    def is_depth(self) -> bool:
        return any(self.facts.get(name) is True for name in ("is_depth_map", "video.is_depth_map"))

    def millimetres(self, key: str, path: Path) -> NDArray[np.uint16] | None:
        """(4096,) depth of each code of a video, 0 for none; None where no range is stated.

        The first and the last code stand for all depth beyond the range, so for no known depth.
        Raises RequestError where the range is not one.
        """
        facts = self.facts
        if "video.depth_min" not in facts:
            return None
        is_log = bool(facts.get("video.use_log", True))
        try:
            low, high = (float(facts[f"video.depth_{end}"]) for end in ("min", "max"))
            shift = float(facts["video.shift"]) if is_log else 0.0
        except (KeyError, TypeError, ValueError):
            low, high, shift = math.nan, math.nan, math.nan
        if not (0 <= low < high <= _MAX_DEPTH and (not is_log or 0 < low + shift < math.inf)):
            raise RequestError(
                f"{path}: {key}: depth_min, depth_max and shift are no range of depth"
            )
        share = np.arange(LAST_CODE + 1) / LAST_CODE
        if is_log:
            metres = (low + shift) * ((high + shift) / (low + shift)) ** share - shift
        else:
            metres = low + (high - low) * share
        metres[[0, LAST_CODE]] = 0.0
        return np.rint(1000 * metres).astype(np.uint16)

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
        keys = self._image_keys(is_depth=False)
        listed = ", ".join(keys) or "none"
        if chosen is not None and chosen not in keys:
            raise RequestError(f"{path}: no images rgb={chosen} (has: {listed})")
        if chosen is None and len(keys) != 1:
            raise RequestError(f"{path}: {len(keys)} cameras; choose one with rgb= (has: {listed})")
        return chosen or keys[0]

    def depth_key(self, path: Path, image: str, chosen: str | None) -> str | None:
        """The feature of the depth that belongs to the images, None for none.

        By default it is that of the name of the images with `_depth`, or the only one of a data
        set with one camera. Raises RequestError where none or several could be meant.
        """
        depths = self._image_keys(is_depth=True)
        if chosen == "none" or (chosen is None and not depths):
            return None
        if chosen in depths:
            return chosen
        listed = ", ".join(depths) or "none"
        if chosen is not None:
            raise RequestError(f"{path}: no depth depth={chosen} (has: {listed})")
        if (own := f"{image}_depth") in depths:
            return own
        if len(depths) == len(self._image_keys(is_depth=False)) == 1:
            return depths[0]
        raise RequestError(
            f"{path}: state the depth of {image} by depth=, or depth=none (has: {listed})"
        )

    def _image_keys(self, is_depth: bool) -> list[str]:
        return [
            name
            for name, feature in self.features.items()
            if feature.dtype in ("video", "image") and feature.is_depth == is_depth
        ]

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
    """An episode: its number, its file of data, and its place in the videos of features.

    A place is the file and the number of the first frame in it. Images of features without a place
    are in the file of data.
    """

    number: int
    data: str
    videos: Mapping[str, tuple[str, int]]

    def place(
        self, key: str, data: FrameNumbers, rows: NDArray[np.intp]
    ) -> tuple[str, NDArray[np.intp]]:
        """The file of the images of a feature, and the number of each row's image in it."""
        if key not in self.videos:
            return self.data, rows
        file, first = self.videos[key]
        return file, data.numbers("frame_index", rows).astype(np.intp) + first


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


def episodes_of(folder: Path, info: Info, images: Sequence[str]) -> Iterator[Episode]:
    """The episodes, with the files of the features `images`. Raises RequestError for damage."""
    template = info.video_path
    keys = [] if template is None else [k for k in images if info.features[k].dtype == "video"]
    where = folder / "meta/info.json"
    if info.codebase_version.startswith("v2."):
        for number in range(info.total_episodes):
            values: dict[str, str | int] = {
                "episode_chunk": number // info.chunks_size,
                "episode_index": number,
            }
            yield Episode(
                number,
                _filled(info.data_path, values, where),
                {k: (_filled(template or "", values | {"video_key": k}, where), 0) for k in keys},
            )
        return
    for path in sorted((folder / "meta/episodes").glob("chunk-*/file-*.parquet")):
        yield from _listed_episodes(path, info, keys)


def _listed_episodes(path: Path, info: Info, keys: Sequence[str]) -> Iterator[Episode]:
    names = ["episode_index", "data/chunk_index", "data/file_index"]
    places = ("chunk_index", "file_index", "from_timestamp")
    names += [f"videos/{key}/{name}" for key in keys for name in places]
    columns = read_columns(path, names, ())
    if missing := [name for name in names if name not in columns]:
        raise RequestError(f"{path}: no column {missing[0]}")
    for row in np.column_stack([columns[name] for name in names]).tolist():
        if not all(abs(value) <= _MAX_NUMBER for value in row):
            raise RequestError(f"{path}: an episode without a number in {', '.join(names)}")
        data = {"chunk_index": int(row[1]), "file_index": int(row[2])}
        videos = {}
        for key, (chunk, file, start) in zip(keys, np.reshape(row[3:], (-1, 3)), strict=True):
            values = {"chunk_index": int(chunk), "file_index": int(file), "video_key": key}
            videos[key] = _filled(info.video_path or "", values, path), round(start * info.fps)
        yield Episode(int(row[0]), _filled(info.data_path, data, path), videos)


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
