"""Images that lie in files: found, listed by number, and read."""

from __future__ import annotations

import hashlib
import os
import re
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_bytes
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import (
    declared_size,
    declared_type,
    decode_image,
    most_bytes,
)
from s2rtools.datasets.recording import RecordedFrame, SourceImage

_SAMPLES = 25
_MOST_DIGITS = 18
"""Digits of a number in a file name; it fits into 64 bits."""


@dataclass(frozen=True, slots=True)
class ImageFile:
    """A colour or depth image in a file; `name` is its path relative to the recording.

    Images of another `size` (height, width) are reported instead of read, if it is given. With
    `turns` the orientation that the file states applies, which may exchange both edges; else it is
    ignored, because intrinsics are those of the file's pixels.
    """

    path: Path
    name: str
    size: tuple[int, int] | None = None
    is_depth: bool = False
    turns: bool = False

    @property
    def pixels(self) -> int:
        height, width = self.size or declared_size(self.path) or (0, 0)
        return height * width

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.path,)

    @property
    def declared_type(self) -> str | None:
        return declared_type(self.path)

    def checksum(self) -> str | None:
        try:
            return hashlib.sha256(self._content()).hexdigest()
        except RequestError:
            return None

    def read(self) -> SourceImage | InputIssue:
        try:
            content = self._content()
        except RequestError as error:
            detail = str(error).removeprefix(f"{self.path}: ")
            return InputIssue("unreadable image", self.name, detail)
        mode = cv2.IMREAD_UNCHANGED if self.is_depth else cv2.IMREAD_COLOR_RGB
        if not (self.is_depth or self.turns):
            mode |= cv2.IMREAD_IGNORE_ORIENTATION
        decoded = decode_image(content, self.name, mode, self.size, self.turns)
        if isinstance(decoded, InputIssue):
            return decoded
        return SourceImage(decoded[0], hashlib.sha256(content).hexdigest(), decoded[1])

    def _content(self) -> bytes:
        pixels = MAX_PIXELS if self.size is None else self.pixels
        return read_bytes(self.path, most_bytes(pixels))


class NumberedFiles:
    """The files of a folder whose names contain a number, by ascending number."""

    def __init__(self, folder: Path, pattern: re.Pattern[str]) -> None:
        """List the names that `pattern` matches as a whole; its first group is the number.

        Of several names with one number the first in alphabetical order counts, and the others are
        in `repeated`. Raises RequestError if the folder cannot be read.
        """
        names, numbers = [], array("q")
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    match = pattern.fullmatch(entry.name)
                    if match and len(match[1]) <= _MOST_DIGITS:
                        names.append(entry.name.encode("ascii"))
                        numbers.append(int(match[1]))
        except OSError as error:
            raise RequestError(f"{folder}: cannot be read ({error.strerror})") from error
        texts = np.array(names, dtype=np.bytes_)
        order = np.lexsort((texts, np.asarray(numbers)))
        found = np.asarray(numbers, dtype=np.int64)[order]
        again = np.zeros(len(found), dtype=bool)
        again[1:] = np.diff(found) == 0
        self.numbers: NDArray[np.int64] = found[~again]
        self.repeated: list[str] = [text.decode("ascii") for text in texts[order[again]]]
        self._texts = texts[order[~again]]

    def __len__(self) -> int:
        return len(self.numbers)

    def name(self, number: int) -> str | None:
        """The file name of a number; None if there is no such file."""
        row = int(np.searchsorted(self.numbers, number))
        if row == len(self.numbers) or self.numbers[row] != number:
            return None
        return str(self._texts[row].decode("ascii"))


def commonest_size(
    frames: Sequence[RecordedFrame], where: object, depth: bool = False
) -> tuple[int, int]:
    """The most frequent (height, width) in the headers of up to 25 RGB or `depth` images.

    They are spread evenly over all; if none of them can be read, it is the size of the first that
    can. Raises RequestError, beginning with `where`, if there is none.
    """
    rows = np.linspace(0, len(frames) - 1, _SAMPLES).round() if frames else np.zeros(0)
    found = (_size(frames[int(row)], depth) for row in np.unique(rows))
    sizes = Counter(size for size in found if size is not None)
    if sizes:
        return sizes.most_common(1)[0][0]
    for frame in frames:
        if size := _size(frame, depth):
            return size
    raise RequestError(f"{where}: no {'depth' if depth else 'RGB'} image can be read")


def _size(frame: RecordedFrame, depth: bool) -> tuple[int, int] | None:
    image = frame.depth if depth else frame.rgb
    if isinstance(image, ImageFile):
        return declared_size(image.path)
    return None
