"""Images of a recording that lie in files, and checks that the readers of layouts share.

The orientation that an image file states is ignored, because intrinsics are those of its pixels.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_bytes
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.datasets.image_decoding import MAX_METADATA_BYTES, declared_size, decode_image
from s2rtools.datasets.lazy_sequence import LazySequence
from s2rtools.datasets.recording import RecordedFrame, SourceImage
from s2rtools.datasets.scan import InputIssue

_MAX_BYTES = 8 * MAX_PIXELS + MAX_METADATA_BYTES
_COLOUR = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
_OTHER_CHARACTERS = re.compile(r"[^\w.+-]", re.ASCII)


@dataclass(frozen=True, slots=True)
class RgbImageFile:
    """A colour image in a file; `name` is its path relative to the recording.

    Images of another `size` (height, width) are reported instead of read, if it is given.
    """

    path: Path
    name: str
    size: tuple[int, int] | None = None

    @property
    def pixels(self) -> int:
        height, width = declared_size(self.path) or (0, 0)
        return height * width

    def checksum(self) -> str | None:
        return _checksum(self.path)

    def read(self) -> SourceImage | InputIssue:
        return _read(self.path, self.name, _COLOUR, self.size)


@dataclass(frozen=True, slots=True)
class DepthImageFile:
    """A depth image in a file, one channel of 8 or 16 bits; the rest as in `RgbImageFile`."""

    path: Path
    name: str
    size: tuple[int, int] | None = None

    @property
    def pixels(self) -> int:
        height, width = declared_size(self.path) or (0, 0)
        return height * width

    def checksum(self) -> str | None:
        return _checksum(self.path)

    def read(self) -> SourceImage | InputIssue:
        image = _read(self.path, self.name, cv2.IMREAD_UNCHANGED, self.size)
        if isinstance(image, InputIssue):
            return image
        if image.pixels.ndim != 2 or image.pixels.dtype not in (np.uint8, np.uint16):
            channels = image.pixels.shape[2] if image.pixels.ndim == 3 else 1
            found = f"{channels} channels of type {image.pixels.dtype}"
            return InputIssue("not a depth image", self.name, f"{found}, expected 1 of 16 bits")
        return image


def frames_of_files(
    root: Path, names: Sequence[tuple[str, str | None]], size: tuple[int, int]
) -> Sequence[RecordedFrame]:
    """Frames of RGB images of (height, width) and depth images, by names relative to `root`."""

    def frame(row: int) -> RecordedFrame:
        rgb, depth = names[row]
        return RecordedFrame(
            RgbImageFile(root / rgb, rgb, size),
            None if depth is None else DepthImageFile(root / depth, depth),
        )

    return LazySequence(len(names), frame)


def trajectory_name(path: Path) -> str:
    """The name of a file or folder, without suffix, as a name that a trajectory may have."""
    name = path.absolute().stem if path.is_file() else path.absolute().name
    return _OTHER_CHARACTERS.sub("_", name)[:80].lstrip("_.+-").replace("..", "_") or "recording"


def _checksum(path: Path) -> str | None:
    try:
        return hashlib.sha256(read_bytes(path, _MAX_BYTES)).hexdigest()
    except RequestError:
        return None


def _read(
    path: Path, name: str, mode: int, size: tuple[int, int] | None
) -> SourceImage | InputIssue:
    try:
        content = read_bytes(path, _MAX_BYTES)
    except RequestError as error:
        return InputIssue("unreadable image", name, str(error).removeprefix(f"{path}: "))
    decoded = decode_image(content, name, mode, size)
    if isinstance(decoded, InputIssue):
        return decoded
    return SourceImage(decoded[0], hashlib.sha256(content).hexdigest(), decoded[1])
