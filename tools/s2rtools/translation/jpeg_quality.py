"""Quality with which a JPEG image was encoded, from its quantization table."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image, JpegImagePlugin

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
_DEFAULT = 90


def jpeg_quality(content: bytes) -> int:
    """Quality 1 .. 100 whose table of the Independent JPEG Group is nearest to that of the image.

    90 for images that are no JPEG or have no table.
    """
    try:
        with Image.open(io.BytesIO(content), formats=["JPEG"]) as image:
            tables = image.quantization if isinstance(image, JpegImagePlugin.JpegImageFile) else {}
    except (OSError, ValueError, SyntaxError):
        return _DEFAULT
    if len(tables.get(0, ())) != 64:
        return _DEFAULT
    distances = np.abs(_tables() - np.sort(np.array(tables[0]))).sum(axis=1)
    return int(distances.argmin()) + 1


def _tables() -> NDArray[np.int64]:
    """Sorted tables (100, 64) of the qualities 1 .. 100, scaled as by the Independent JPEG Group:
    5000 / q percent below 50, else 200 - 2 q percent."""
    quality = np.arange(1, 101)
    percent = np.where(quality < 50, 5000 // quality, 200 - 2 * quality)
    return np.clip((_LUMINANCE * percent[:, None] + 50) // 100, 1, 255)
