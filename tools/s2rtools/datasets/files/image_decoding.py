"""Decode images, check them, and make frames of them: resized, with the share of valid depth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, counted
from s2rstore.files.image_header import ImageHeader, read_header
from s2rstore.files.input_files import open_regular
from s2rstore.records import Domain
from s2rtools.common import image_files
from s2rtools.common.frame_resizing import resized_depth, resized_rgb
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.scan import DecodedFrame, Scan, SourceImages

_MAX_DEPTH_COLOUR_SPREAD = 8
_PHOTO_DIFFERENCE = 6.0
_PHOTO_CORRELATION = 0.98
_MAX_METADATA_BYTES = 4 << 20
"""Bytes of an image file besides its pixels."""
_USUAL_HEADER_BYTES = 4 << 10
_ASPECT_TOLERANCE = 0.02
"""Share by which an image may be stretched without a report; rounding of the size explains it."""


def depth_of(pixels: NDArray[Any], name: str) -> NDArray[Any] | InputIssue:
    """A depth image (h, w), also of one that repeats its channel; `name` is that of its file."""
    if pixels.ndim == 3:
        if np.ptp(pixels[..., :3].astype(np.int16), axis=2).max() > _MAX_DEPTH_COLOUR_SPREAD:
            return InputIssue("not a depth image", name, "it is a colour image")
        pixels = pixels[..., 0]
    return wrong_depth(pixels, name) or np.ascontiguousarray(pixels)


def wrong_depth(pixels: NDArray[Any], name: str) -> InputIssue | None:
    """Why pixels are no depth image of one channel of 8 or 16 bits; None if they are one."""
    if pixels.ndim == 2 and pixels.dtype in (np.uint8, np.uint16):
        return None
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    found = f"{counted(channels, 'channel')} of type {pixels.dtype}"
    return InputIssue("not a depth image", name, f"{found}, expected 1 of 16 bits")


def made_frame(
    scan: Scan,
    domain: Domain,
    rgb: tuple[NDArray[Any], int],
    depth: NDArray[Any] | None,
    sha256: str,
    name: str,
) -> DecodedFrame:
    """Resize the images of one frame, RGB with its bits per sample; `name` is that of RGB.

    RGB is averaged over areas, depth takes the nearest source pixel, so that every stored value
    occurs in the file and validity needs no second mask. The images of another size are kept as
    they are, for networks; without poses, an image of another aspect ratio is reported.
    """
    colours, bits = rgb
    issues, source = list[InputIssue](), None
    if bits > 8:
        detail = f"{bits} bits; stored with 8"
        issues.append(InputIssue("colours of more than 8 bits", name, detail))
    (height, width), (rows, columns) = colours.shape[:2], scan.frame
    if scan.has_poses and {i.shape[:2] for i in (colours, depth) if i is not None} != {scan.frame}:
        source = SourceImages(colours, depth)
        if not source.is_storable:
            source, detail = None, f"{size_text(colours.shape)}; networks see the stored frame"
            issues.append(InputIssue("image too large to be kept", name, detail))
    elif not scan.has_poses and abs(width * rows / (height * columns) - 1) > _ASPECT_TOLERANCE:
        detail = f"{size_text(colours.shape)}; stretched to {size_text(scan.frame)}"
        issues.append(InputIssue("other aspect ratio", name, detail))
    raw, is_valid = None, np.array(np.nan)
    if depth is not None:
        raw = resized_depth(depth, scan.frame)
        is_valid = (raw >= domain.depth_raw_min) & (raw <= domain.depth_raw_max)
    small = resized_rgb(colours, scan.frame)
    return DecodedFrame(small, raw, sha256, float(is_valid.mean()), tuple(issues), source)


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


def most_bytes(pixels: int) -> int:
    """Bytes of the largest image file of some pixels: four channels of 16 bits, and metadata."""
    return 8 * pixels + _MAX_METADATA_BYTES


def _wrong_size(name: str, size: tuple[int, ...], expected: tuple[int, int]) -> InputIssue:
    return InputIssue("wrong size", name, f"{size_text(size)}, expected {size_text(expected)}")


def is_photo(depth: NDArray[Any], rgb: NDArray[np.uint8]) -> bool:
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
                return read_header(content + file.read(_MAX_METADATA_BYTES - len(content)))
    except (RequestError, ValueError):
        return None


def size_text(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
