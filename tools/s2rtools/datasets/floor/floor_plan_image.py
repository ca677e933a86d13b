"""Read the image of a data set's floor plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.image_header import read_header
from s2rstore.files.input_files import read_bytes
from s2rtools.common.image_files import MAX_PIXELS, whole_image

_MAX_BYTES = 256 << 20
_MAX_ASPECT_RATIO = 50
"""Longer side over shorter side."""


def read_floor_plan(path: Path) -> NDArray[Any] | None:
    """The image, (h, w, 3) uint8 BGR; None if it is not an image or is damaged.

    Raises RequestError if the file is too large or declares an implausible size.
    """
    content = read_bytes(path, _MAX_BYTES)
    try:
        header = read_header(content)
    except ValueError:
        return None
    size = f"{path}: {header.width}x{header.height} pixels"
    if header.pixels > MAX_PIXELS:
        raise RequestError(f"{size}; a floor plan has at most {MAX_PIXELS:,} in all; scale it")
    if max(header.size) > _MAX_ASPECT_RATIO * min(header.size):
        raise RequestError(
            f"{size}; the longer side of a floor plan is at most {_MAX_ASPECT_RATIO} times "
            "the shorter"
        )
    try:
        whole = np.frombuffer(whole_image(content, header), np.uint8)
        return cv2.imdecode(whole, cv2.IMREAD_COLOR)
    except (ValueError, cv2.error):
        return None
