"""Frames of videos as images of a recording."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.lazy_sequence import LazySequence
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.video_files import Video
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import RecordedFrame, SourceImage

_CACHED = 16
"""Decoded frames that are held: threads ask for neighbours in any order."""


class ImageStore(Protocol):
    """Images by file and number, from any thread."""

    def read(self, file: str, number: int) -> SourceImage | InputIssue: ...
    def path(self, file: str) -> Path: ...


@dataclass(frozen=True, slots=True)
class StoredImage:
    """An image of an `ImageStore`; see `recording.RecordedImage`."""

    images: ImageStore
    file: str
    number: int
    size: tuple[int, int]

    @property
    def name(self) -> str:
        return f"{self.file}:{self.number}"

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.images.path(self.file),)

    def checksum(self) -> str | None:
        image = self.images.read(self.file, self.number)
        return None if isinstance(image, InputIssue) else image.sha256

    def read(self) -> SourceImage | InputIssue:
        image = self.images.read(self.file, self.number)
        if isinstance(image, SourceImage) and image.pixels.shape[:2] != self.size:
            height, width = image.pixels.shape[:2]
            expected = f"expected {self.size[1]}x{self.size[0]}"
            return InputIssue("wrong size", self.name, f"{width}x{height}, {expected}")
        return image


@dataclass(frozen=True, slots=True, eq=False)
class ImageStream:
    """Images of one size (height, width) in a file: the number in it of each frame's, (N,)."""

    images: ImageStore
    file: str
    numbers: NDArray[np.intp]
    size: tuple[int, int]

    def image(self, row: int) -> StoredImage:
        return StoredImage(self.images, self.file, int(self.numbers[row]), self.size)


def frames_of(streams: Sequence[ImageStream]) -> LazySequence[RecordedFrame]:
    """The frames of a stream of colour images, and perhaps one of depth images."""
    count = len(streams[0].numbers)
    return LazySequence(count, lambda row: RecordedFrame(*(each.image(row) for each in streams)))


class VideoImages:
    """Frames of videos; the SHA-256 is that of the decoded pixels.

    One video is open at a time. `codec` names in messages what a description of the videos states.
    """

    def __init__(self, containment: PathContainment, codec: str = "unknown") -> None:
        self._containment, self._codec = containment, codec
        self._lock = threading.Lock()
        self._file: str | None = None
        self._video: Video | None = None
        self._reason = ""
        self._frames: dict[int, NDArray[Any]] = {}

    def read(self, file: str, number: int) -> SourceImage | InputIssue:
        with self._lock:
            self._open(file)
            pixels = self._frames.get(number)
            if pixels is None and self._video is not None:
                pixels = self._decoded(self._video, number)
        if pixels is None:
            detail = self._reason or f"frame {number} of a video in {self._codec} is not decodable"
            return InputIssue("unreadable image", f"{file}:{number}", detail)
        bits = 8 * pixels.dtype.itemsize
        return SourceImage(pixels, hashlib.sha256(pixels.tobytes()).hexdigest(), bits)

    def path(self, file: str) -> Path:
        """The path of a file of the recording."""
        return self._containment.folder / file

    def _open(self, file: str) -> None:
        if file == self._file:
            return
        if self._video is not None:
            self._video.close()
        self._frames.clear()
        self._file, self._video, self._reason = file, None, ""
        try:
            path = self._containment.resolve(file, str(self._containment.folder))
            self._video = Video(path)
        except RequestError as error:
            self._reason = str(error)

    def _decoded(self, video: Video, number: int) -> NDArray[Any] | None:
        try:
            for place, pixels in video.read(number):
                self._frames[place] = pixels
                while len(self._frames) > _CACHED:
                    del self._frames[next(iter(self._frames))]
        except RequestError as error:
            self._reason = str(error)
        return self._frames.get(number)
