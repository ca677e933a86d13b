"""Images of a recording that lie in files, and checks that the readers of layouts share."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_bytes
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.datasets.image_decoding import MAX_METADATA_BYTES, declared_size, decode_image
from s2rtools.datasets.recording import SourceImage
from s2rtools.datasets.scan import InputIssue

_MAX_BYTES = 8 * MAX_PIXELS + MAX_METADATA_BYTES


@dataclass(frozen=True, slots=True)
class RgbImageFile:
    """A colour image in a file; `name` is its path relative to the recording."""

    path: Path
    name: str

    @property
    def pixels(self) -> int:
        height, width = declared_size(self.path) or (0, 0)
        return height * width

    def checksum(self) -> str | None:
        return _checksum(self.path)

    def read(self) -> SourceImage | InputIssue:
        return _read(self.path, self.name, cv2.IMREAD_COLOR_RGB)


@dataclass(frozen=True, slots=True)
class DepthImageFile:
    """A depth image in a file, one channel of 8 or 16 bits; `name` as in `RgbImageFile`."""

    path: Path
    name: str

    @property
    def pixels(self) -> int:
        height, width = declared_size(self.path) or (0, 0)
        return height * width

    def checksum(self) -> str | None:
        return _checksum(self.path)

    def read(self) -> SourceImage | InputIssue:
        image = _read(self.path, self.name, cv2.IMREAD_UNCHANGED)
        if isinstance(image, InputIssue):
            return image
        if image.pixels.ndim != 2 or image.pixels.dtype not in (np.uint8, np.uint16):
            channels = image.pixels.shape[2] if image.pixels.ndim == 3 else 1
            found = f"{channels} channels of type {image.pixels.dtype}"
            return InputIssue("not a depth image", self.name, f"{found}, expected 1 of 16 bits")
        return image


def _checksum(path: Path) -> str | None:
    try:
        return hashlib.sha256(read_bytes(path, _MAX_BYTES)).hexdigest()
    except RequestError:
        return None


def _read(path: Path, name: str, mode: int) -> SourceImage | InputIssue:
    try:
        content = read_bytes(path, _MAX_BYTES)
    except RequestError as error:
        return InputIssue("unreadable image", name, str(error).removeprefix(f"{path}: "))
    decoded = decode_image(content, name, mode)
    if isinstance(decoded, InputIssue):
        return decoded
    return SourceImage(decoded[0], hashlib.sha256(content).hexdigest(), decoded[1])
