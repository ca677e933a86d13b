"""Decoding one view: both files checked, brought to the stored size, validity counted."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.image_header import check_integrity, read_header
from s2rstore.files.input_files import open_regular, read_bytes
from s2rstore.records import Domain
from s2rtools.datasets.jpeg_entropy import check_jpeg
from s2rtools.datasets.scan import MOST_PIXELS, CheckedFrame, DecodedFrame, InputIssue, Scan

_COLOUR_SPREAD = 8
_PHOTO_DIFFERENCE = 6.0
_PHOTO_CORRELATION = 0.98
_METADATA = 4 << 20
"""Bytes that an image file may hold beside its pixels."""


@dataclass(frozen=True, slots=True)
class Images:
    """The two source files of one view, and the (height, width) that each must have."""

    rgb: Path
    depth: Path
    rgb_size: tuple[int, int]
    depth_size: tuple[int, int]

    @property
    def pixels(self) -> int:
        return max(height * width for height, width in (self.rgb_size, self.depth_size))

    def files(self, scan: Scan) -> tuple[str | None, str | None]:
        return scan.relative(self.rgb), scan.relative(self.depth)

    def check(self, scan: Scan, domain: Domain) -> CheckedFrame | InputIssue:
        found = decode(scan, domain, self)
        if isinstance(found, InputIssue):
            return found
        return CheckedFrame(str(found.depth.dtype), found.notes, found)

    def view(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        return decode(scan, domain, self)


def decode(scan: Scan, domain: Domain, images: Images) -> DecodedFrame | InputIssue:
    """Read, check and resize one view; a Problem names the file that cannot be used.

    RGB is averaged over areas. Depth takes the nearest source pixel, so that every stored value
    is one of the file and validity needs no second mask.
    """
    digest = hashlib.sha256()
    rgb = _read(scan, images.rgb, images.rgb_size, cv2.IMREAD_COLOR_RGB, digest)
    if isinstance(rgb, InputIssue):
        return rgb
    height, width = scan.frame
    small, bits = _resized_rgb(rgb.pixels, (width, height)), rgb.bits
    del rgb
    depth = _read(scan, images.depth, images.depth_size, cv2.IMREAD_UNCHANGED, digest)
    if isinstance(depth, InputIssue):
        return depth
    name = scan.relative(images.depth)
    if depth.pixels.ndim == 3:
        if int(np.ptp(depth.pixels[..., :3].astype(np.int16), axis=2).max()) > _COLOUR_SPREAD:
            return InputIssue("not a depth image", name, "it has colours")
        depth.pixels = depth.pixels[..., 0]
    if depth.pixels.dtype not in (np.uint8, np.uint16):
        return InputIssue("not a depth image", name, f"type {depth.pixels.dtype}")
    raw = cv2.resize(depth.pixels, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    if _is_photo(raw, small):
        return InputIssue("not a depth image", name, "it repeats the RGB image")
    valid = (raw >= domain.depth_raw_min) & (raw <= domain.depth_raw_max)
    notes: tuple[InputIssue, ...] = ()
    if bits > 8:
        detail = f"{bits} bits; stored with 8"
        notes = (InputIssue("colours of more than 8 bits", scan.relative(images.rgb), detail),)
    return DecodedFrame(small, raw, digest.hexdigest(), float(valid.mean()), notes)


@dataclass(slots=True)
class _Decoded:
    """The pixels of a file, and the bits per sample that it had."""

    pixels: NDArray[Any]
    bits: int


def _read(
    scan: Scan, path: Path, size: tuple[int, int], mode: int, digest: Any
) -> _Decoded | InputIssue:
    """Decode an image of an expected (height, width); nothing is decoded for another one."""
    name = scan.relative(path)
    try:
        content = read_bytes(path, _most_bytes(size))
    except RequestError as error:
        return InputIssue("unreadable image", name, str(error).removeprefix(f"{path}: "))
    digest.update(content)
    if not content:
        return InputIssue("unreadable image", name, "empty file")
    try:
        header = read_header(content)
    except ValueError as error:
        return InputIssue("unreadable image", name, str(error))
    if header.size not in (size, size[::-1]):
        return _wrong_size(name, header.size, size)
    try:
        check_integrity(content, header)
        if header.format == "JPEG":
            check_jpeg(content)
    except ValueError as error:
        kind = "truncated image" if "before its" in str(error) else "damaged image"
        return InputIssue(kind, name, str(error))
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), mode)
    except (cv2.error, MemoryError):
        image = None
    if image is None:
        return InputIssue("unreadable image", name, "no picture that can be decoded")
    if image.shape[:2] != size:
        return _wrong_size(name, image.shape, size)
    return _Decoded(np.asarray(image), header.bits)


def _wrong_size(name: str, found: tuple[int, ...], expected: tuple[int, int]) -> InputIssue:
    return InputIssue("wrong size", name, f"{size_text(found)}, expected {size_text(expected)}")


def _most_bytes(size: tuple[int, int]) -> int:
    """The bytes that a file of so many pixels may have: 16 bits in 4 channels, and metadata."""
    return size[0] * size[1] * 8 + _METADATA


def _resized_rgb(rgb: NDArray[Any], size: tuple[int, int]) -> NDArray[np.uint8]:
    shrinks = rgb.shape[1] >= size[0] and rgb.shape[0] >= size[1]
    mode = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(rgb, size, interpolation=mode), dtype=np.uint8)


def _is_photo(depth: NDArray[Any], rgb: NDArray[np.uint8]) -> bool:
    """Whether an 8-bit depth image is the grey version of the RGB image."""
    if depth.dtype != np.uint8:
        return False
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    if float(cv2.absdiff(grey, depth).mean()) >= _PHOTO_DIFFERENCE or not depth.any():
        return False
    with np.errstate(invalid="ignore"):
        return bool(np.corrcoef(grey.ravel(), depth.ravel())[0, 1] > _PHOTO_CORRELATION)


def declared_size(path: Path) -> tuple[int, int] | None:
    """(height, width) that an image file declares; None where it is none or too large."""
    try:
        with open_regular(path) as file:
            header = read_header(file.read(_METADATA))
    except (RequestError, ValueError):
        return None
    return header.size if header.pixels <= MOST_PIXELS else None


def size_text(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
