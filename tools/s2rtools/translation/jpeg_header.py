"""Size and quality of a JPEG image from its header, without decoding it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_LUMINANCE = np.sort(
    np.array(
        [
            16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55,
            14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29, 51, 87, 80, 62,
            18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92,
            49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
        ]
    )
)  # fmt: skip
"""Quantization table of luminance in ITU-T T.81, annex K.1, sorted."""
_DEFAULT_QUALITY = 90
_START_OF_IMAGE, _END_OF_IMAGE = b"\xff\xd8", b"\xff\xd9"
_QUANTIZATION, _START_OF_SCAN = 0xDB, 0xDA
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_TAIL = 4096
"""Bytes at the end in which the end marker is searched; cameras append padding."""


class JpegHeader(NamedTuple):
    """Size in pixels and quality 1 .. 100."""

    height: int
    width: int
    quality: int


def read_jpeg_header(content: bytes) -> JpegHeader:
    """The header of a JPEG image. Raises ValueError if the image is damaged or cut off."""
    if not content.startswith(_START_OF_IMAGE):
        raise ValueError("not a JPEG image")
    if _END_OF_IMAGE not in content[-_TAIL:]:
        raise ValueError("a JPEG image that is cut off")
    quality, at = _DEFAULT_QUALITY, 2
    while at + 4 <= len(content):
        if content[at] != 0xFF:
            break
        marker = content[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        length = int.from_bytes(content[at + 2 : at + 4], "big")
        segment = content[at + 4 : at + 2 + length]
        if marker == _START_OF_SCAN or length < 2:
            break
        if marker == _QUANTIZATION:
            quality = _quality(segment) or quality
        if marker in _START_OF_FRAME and len(segment) >= 5:
            height, width = (int.from_bytes(segment[i : i + 2], "big") for i in (1, 3))
            return JpegHeader(height, width, quality)
        at += 2 + length
    raise ValueError("a JPEG image without a size")


def _quality(segment: bytes) -> int | None:
    """Quality of the nearest table of the Independent JPEG Group, if `segment` holds table 0."""
    if not segment or segment[0] & 15:
        return None
    kind = ">u2" if segment[0] >> 4 else ">u1"
    values = np.frombuffer(segment[1 : 1 + 64 * np.dtype(kind).itemsize], dtype=kind)
    if len(values) != 64:
        return None
    distances = np.abs(_tables() - np.sort(values).astype(np.int64)).sum(axis=1)
    return int(distances.argmin()) + 1


def _tables() -> NDArray[np.int64]:
    """Sorted tables (100, 64) of the qualities 1 .. 100, scaled as by the Independent JPEG Group:
    5000 / q percent below 50, else 200 - 2 q percent."""
    quality = np.arange(1, 101)
    percent = np.where(quality < 50, 5000 // quality, 200 - 2 * quality)
    return np.clip((_LUMINANCE * percent[:, None] + 50) // 100, 1, 255)
