"""Decode one frame: check both image files, resize them and count the valid depth pixels."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.image_header import ImageHeader, read_header
from s2rstore.files.input_files import open_regular, read_bytes
from s2rstore.records import Domain
from s2rtools.common import image_files
from s2rtools.common.frame_resizing import resized_depth, resized_rgb
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.scan import DecodedFrame, Scan, SourceImages

_MAX_DEPTH_COLOUR_SPREAD = 8
_PHOTO_DIFFERENCE = 6.0
_PHOTO_CORRELATION = 0.98
_MAX_PIXEL_BYTES = 8
"""Four channels of 16 bits."""
MAX_METADATA_BYTES = 4 << 20
"""Bytes of an image file besides its pixels."""
_USUAL_HEADER_BYTES = 4 << 10
_ASPECT_TOLERANCE = 0.02
"""Share by which an image may be stretched without a report; rounding of the size explains it."""


@dataclass(frozen=True, slots=True)
class ImageFiles:
    """The two source files of one frame and the (height, width) that each must have."""

    rgb: Path
    depth: Path
    rgb_size: tuple[int, int]
    depth_size: tuple[int, int]

    @property
    def paths(self) -> tuple[Path, Path]:
        return self.rgb, self.depth

    @property
    def pixels(self) -> int:
        return max(height * width for height, width in (self.rgb_size, self.depth_size))

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        return scan.relative(self.rgb), scan.relative(self.depth)

    def origin(self) -> tuple[tuple[Path, ...], str]:
        return self.paths, f"{self.rgb_size} {self.depth_size}"

    def declared_depth_type(self) -> str | None:
        return declared_type(self.depth)

    def checksum(self, scan: Scan, domain: Domain) -> str | None:
        return _checksum((self.rgb, self.rgb_size), (self.depth, self.depth_size))

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        """Read, check and resize one frame; an InputIssue names the unusable file.

        The frame is for the screen, the map and comparisons: RGB is averaged over areas, depth
        takes the nearest source pixel, so that every stored value occurs in the file and validity
        needs no second mask. The images of another size are kept as they are, for networks.
        """
        digest = hashlib.sha256()
        rgb = _read(scan, self.rgb, self.rgb_size, cv2.IMREAD_COLOR_RGB, digest)
        if isinstance(rgb, InputIssue):
            return rgb
        colours, bits = rgb
        small = resized_rgb(colours, scan.frame)
        depth = _read(scan, self.depth, self.depth_size, cv2.IMREAD_UNCHANGED, digest)
        if isinstance(depth, InputIssue):
            return depth
        pixels, name = depth[0], scan.relative(self.depth)
        if pixels.ndim == 3:
            if np.ptp(pixels[..., :3].astype(np.int16), axis=2).max() > _MAX_DEPTH_COLOUR_SPREAD:
                return InputIssue("not a depth image", name, "it is a colour image")
            pixels = pixels[..., 0]
        pixels = np.ascontiguousarray(pixels)
        if pixels.dtype not in (np.uint8, np.uint16):
            return InputIssue("not a depth image", name, f"type {pixels.dtype}")
        raw = resized_depth(pixels, scan.frame)
        is_resized = (colours.shape[:2], pixels.shape) != (scan.frame, scan.frame)
        source = SourceImages(colours, pixels) if is_resized else None
        issues = _lost_bits(scan.relative(self.rgb), bits)
        if source is not None and not source.is_storable:
            source, detail = None, f"{size_text(colours.shape)}; networks see the stored frame"
            issues += (InputIssue("image too large to be kept", scan.relative(self.rgb), detail),)
        if _is_photo(raw, small):
            return InputIssue("not a depth image", name, "it repeats the RGB image")
        valid = (raw >= domain.depth_raw_min) & (raw <= domain.depth_raw_max)
        return DecodedFrame(small, raw, digest.hexdigest(), float(valid.mean()), issues, source)


@dataclass(frozen=True, slots=True)
class RgbFile:
    """One image file without depth, of any size.

    `size` (height, width) is what its header declares; the orientation that the file states may
    exchange both. `name` is its name in reports and in the index.
    """

    path: Path
    name: str
    size: tuple[int, int]

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        return self.name, None

    def origin(self) -> tuple[tuple[Path, ...], str]:
        return (self.path,), f"{self.name!a} {self.size}"

    def checksum(self, scan: Scan, domain: Domain) -> str | None:
        return _checksum((self.path, self.size))

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        """Read and check the image, and resize it to the frame; an InputIssue names the file.

        An image of another aspect ratio is stretched, and reported.
        """
        digest = hashlib.sha256()
        read = _read(
            scan, self.path, self.size, cv2.IMREAD_COLOR_RGB, digest, self.name, may_turn=True
        )
        if isinstance(read, InputIssue):
            return read
        rgb, bits = read
        issues = _lost_bits(self.name, bits)
        (height, width), (rows, columns) = rgb.shape[:2], scan.frame
        if abs(width * rows / (height * columns) - 1) > _ASPECT_TOLERANCE:
            detail = f"{size_text(rgb.shape)}; stretched to {size_text(scan.frame)}"
            issues += (InputIssue("other aspect ratio", self.name, detail),)
        small = resized_rgb(rgb, scan.frame)
        return DecodedFrame(small, None, digest.hexdigest(), float("nan"), issues)


def _lost_bits(name: str, bits: int) -> tuple[InputIssue, ...]:
    if bits <= 8:
        return ()
    return (InputIssue("colours of more than 8 bits", name, f"{bits} bits; stored with 8"),)


def _checksum(*files: tuple[Path, tuple[int, int]]) -> str | None:
    """SHA-256 over the bytes of image files of (height, width); None where one is unreadable."""
    digest = hashlib.sha256()
    try:
        for path, size in files:
            digest.update(read_bytes(path, _most_bytes(size)))
    except RequestError:
        return None
    return digest.hexdigest()


def _most_bytes(size: tuple[int, int]) -> int:
    return size[0] * size[1] * _MAX_PIXEL_BYTES + MAX_METADATA_BYTES


def _read(
    scan: Scan,
    path: Path,
    size: tuple[int, int],
    mode: int,
    digest: Any,
    name: str = "",
    may_turn: bool = False,
) -> tuple[NDArray[Any], int] | InputIssue:
    """Pixels and bits per sample of an image; other sizes than (height, width) are not decoded.

    `name` stands for the path in reports. With `may_turn` the decoded image may be (width, height).
    """
    name = name or scan.relative(path)
    try:
        content = read_bytes(path, _most_bytes(size))
    except RequestError as error:
        return InputIssue("unreadable image", name, str(error).removeprefix(f"{path}: "))
    digest.update(content)
    return decode_image(content, name, mode, size, may_turn)


def decode_image(
    content: bytes,
    name: str,
    mode: int,
    size: tuple[int, int] | None = None,
    may_turn: bool = False,
) -> tuple[NDArray[Any], int] | InputIssue:
    """Pixels and bits per sample of an encoded image; `mode` is that of OpenCV's `imdecode`.

    Images of another (height, width) than `size`, by default of more than `MAX_PIXELS`, are not
    decoded. `name` is the file's name in the issue. With `may_turn` the decoded image may be
    (width, height).
    """
    if not content:
        return InputIssue("unreadable image", name, "empty file")
    try:
        header = read_header(content)
        if size is None:
            size = image_files.declared_size(content)
    except ValueError as error:
        return InputIssue("unreadable image", name, str(error))
    if header.size not in (size, size[::-1]):
        return _wrong_size(name, header.size, size)
    try:
        content = image_files.whole_image(content, header)
    except ValueError as error:
        kind = "truncated image" if "before its" in str(error) else "damaged image"
        return InputIssue(kind, name, str(error))
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), mode)
    except (cv2.error, MemoryError):
        image = None
    if image is None:
        return InputIssue("unreadable image", name, "it cannot be decoded")
    if image.shape[:2] != size and not (may_turn and image.shape[1::-1] == size):
        return _wrong_size(name, image.shape, size)
    return np.asarray(image), header.bits


def _wrong_size(name: str, size: tuple[int, ...], expected: tuple[int, int]) -> InputIssue:
    return InputIssue("wrong size", name, f"{size_text(size)}, expected {size_text(expected)}")


def _is_photo(depth: NDArray[Any], rgb: NDArray[np.uint8]) -> bool:
    """Whether an 8-bit depth image is a greyscale copy of the RGB image."""
    if depth.dtype != np.uint8:
        return False
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    if float(cv2.absdiff(grey, depth).mean()) >= _PHOTO_DIFFERENCE or not depth.any():
        return False
    with np.errstate(invalid="ignore"):
        return bool(np.corrcoef(grey.ravel(), depth.ravel())[0, 1] > _PHOTO_CORRELATION)


def declared_size(path: Path) -> tuple[int, int] | None:
    """(height, width) in an image file's header; None if it is not an image or too large."""
    header = _header(path)
    return None if header is None or header.pixels > image_files.MAX_PIXELS else header.size


def declared_type(path: Path) -> str | None:
    """The numpy type of the samples of an image file by its header; None if it is not an image."""
    header = _header(path)
    return None if header is None else type_of_bits(header.bits)


def type_of_bits(bits: int) -> str:
    """The numpy type of samples as they are decoded."""
    return "uint8" if bits <= 8 else "uint16"


def _header(path: Path) -> ImageHeader | None:
    try:
        with open_regular(path) as file:
            content = file.read(_USUAL_HEADER_BYTES)
            try:
                return read_header(content)
            except ValueError:  # perhaps the header is longer
                return read_header(content + file.read(MAX_METADATA_BYTES - len(content)))
    except (RequestError, ValueError):
        return None


def size_text(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
