"""Decode images of messages to RGB, and encode RGB in the format that the image had.

Compressed images are JPEG or PNG with 8 bits. Raw images have rows of `step` bytes in one of
`ENCODINGS`. Grey images are translated as RGB with equal channels and become grey again; alpha
channels and the padding of rows are kept.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from s2rstore.files.image_header import check_integrity, read_header
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.translation.image_set import Rgb

_FORMATS = ("PNG", "JPEG")
_SWAPPED = {3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}
_DEFAULT_QUALITY = 90


class UndecodableImageError(ValueError):
    """The reason, in one line, why an image cannot be decoded."""


class ImageFormat(Protocol):
    """Format of one decoded image."""

    def encode(self, rgb: Rgb) -> bytes:
        """The content of an image (H, W, 3) of the same size in this format."""
        ...


class RawLayout(NamedTuple):
    """Layout of a raw image: an encoding of ROS, pixels, and bytes per row."""

    encoding: str
    height: int
    width: int
    step: int


class _Channels(NamedTuple):
    number: int
    reversed: bool = False


ENCODINGS: dict[str, _Channels] = {
    "rgb8": _Channels(3),
    "bgr8": _Channels(3, reversed=True),
    "rgba8": _Channels(4),
    "bgra8": _Channels(4, reversed=True),
    "mono8": _Channels(1),
    "8UC1": _Channels(1),
    "8UC3": _Channels(3, reversed=True),
    "8UC4": _Channels(4, reversed=True),
}
"""Encodings of `sensor_msgs/Image` that are translated; OpenCV's own hold blue first."""


@dataclass(frozen=True, slots=True, eq=False)
class RawFormat:
    """Format of a raw image; `rows` (H, step) are its bytes."""

    layout: RawLayout
    rows: NDArray[np.uint8]

    def encode(self, rgb: Rgb) -> bytes:
        channels = ENCODINGS[self.layout.encoding]
        rows = self.rows.copy()
        pixels = _pixels(rows, self.layout, channels.number)
        if channels.number == 1:
            pixels[..., 0] = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        else:
            pixels[..., :3] = rgb[..., ::-1] if channels.reversed else rgb
        return rows.tobytes()


@dataclass(frozen=True, slots=True, eq=False)
class CompressedFormat:
    """Format of a compressed image: `jpeg` are settings of Pillow for JPEG, None for PNG; `alpha`
    (H, W) or None."""

    grey: bool
    jpeg: Mapping[str, Any] | None
    alpha: NDArray[np.uint8] | None = None

    def encode(self, rgb: Rgb) -> bytes:
        if self.jpeg is not None:
            content, image = io.BytesIO(), Image.fromarray(rgb)
            (image.convert("L") if self.grey else image).save(content, "JPEG", **self.jpeg)
            return content.getvalue()
        pixels = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY if self.grey else cv2.COLOR_RGB2BGR)
        if self.alpha is not None:
            pixels = np.dstack([pixels, self.alpha])
        return cv2.imencode(".png", pixels)[1].tobytes()


def decode_raw(content: bytes, layout: RawLayout) -> tuple[Rgb, ImageFormat]:
    """RGB (H, W, 3) of a raw image, and its format. Raises UndecodableImageError."""
    encoding, height, width, step = layout
    channels = ENCODINGS.get(encoding)
    if channels is None:
        raise UndecodableImageError(
            f"encoding {encoding[:40]!r} is not translated; convert to {', '.join(ENCODINGS)}"
        )
    _check_size(height, width)
    if step < width * channels.number:
        raise UndecodableImageError(f"step {step} is less than a row of {width} {encoding} pixels")
    if len(content) != height * step:
        raise UndecodableImageError(
            f"{len(content)} bytes, but {height} rows of step {step} are {height * step}"
        )
    rows = np.frombuffer(content, dtype=np.uint8).reshape(height, step)
    pixels = _pixels(rows, layout, channels.number)
    if channels.number == 1:
        rgb = np.repeat(pixels, 3, axis=2)
    else:
        rgb = np.ascontiguousarray(pixels[..., 2::-1] if channels.reversed else pixels[..., :3])
    return rgb, RawFormat(layout, rows)


def decode_compressed(
    content: bytes, quality: int | None = None, oriented: bool = False
) -> tuple[Rgb, ImageFormat]:
    """RGB (H, W, 3) of a JPEG or PNG image, and its format.

    `quality` is that of JPEG for encoding; None keeps the quantization tables of the image. With
    `oriented`, a JPEG image is turned as its metadata state, which encoding leaves out. Raises
    UndecodableImageError.
    """
    try:
        header = read_header(content)
        if header.format not in _FORMATS:
            raise ValueError(f"a {header.format} image")
        _check_size(*header.size)
        check_integrity(content, header)
    except UndecodableImageError:
        raise
    except ValueError as error:
        raise UndecodableImageError(f"{error}; JPEG and PNG are decoded") from error
    jpeg = None
    if header.format == "JPEG":
        jpeg = _quantization(content) if quality is None else {"quality": quality}
    # IMREAD_ANYCOLOR turns the image, and drops only the alpha channel, which JPEG has not.
    mode = cv2.IMREAD_ANYCOLOR if oriented and jpeg else cv2.IMREAD_UNCHANGED
    try:
        pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), mode)
    except cv2.error as error:
        raise UndecodableImageError(f"a damaged {header.format} image") from error
    if pixels is None:
        raise UndecodableImageError(f"a damaged {header.format} image")
    if pixels.dtype != np.uint8:
        raise UndecodableImageError(f"{pixels.dtype} pixels; images of 8 bits are translated")
    grey = pixels.ndim == 2
    rgb = cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB if grey else _SWAPPED[pixels.shape[2]])
    alpha = pixels[..., 3] if not grey and pixels.shape[2] == 4 else None
    return rgb, CompressedFormat(grey, jpeg, alpha)


def _pixels(rows: NDArray[np.uint8], layout: RawLayout, count: int) -> NDArray[np.uint8]:
    """View (H, W, count) of the pixels in rows (H, step)."""
    height, width = layout.height, layout.width
    strides = (rows.strides[0], count, 1)
    return np.lib.stride_tricks.as_strided(rows, (height, width, count), strides)


def _check_size(height: int, width: int) -> None:
    if min(height, width) < 1 or height * width > MAX_PIXELS:
        raise UndecodableImageError(f"{width} x {height} pixels; 1 to {MAX_PIXELS:,} are decoded")


def _quantization(content: bytes) -> dict[str, Any]:
    """Settings of Pillow that keep the quantization tables of a JPEG image.

    Those of quality 90 for images that have no table.
    """
    try:
        with Image.open(io.BytesIO(content), formats=["JPEG"]) as image:
            tables = list(getattr(image, "quantization", {}).values())[:3]
    except (OSError, ValueError, SyntaxError):
        tables = []
    return {"qtables": tables} if tables else {"quality": _DEFAULT_QUALITY}
