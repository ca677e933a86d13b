"""Resize images to the frame size, at which a store shows, maps and compares them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray


def resized_rgb(rgb: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """An image (h, w, 3) as (*size, 3): averaged over areas, interpolated where it grows."""
    shrinks = rgb.shape[0] >= size[0] and rgb.shape[1] >= size[1]
    mode = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(rgb, size[::-1], interpolation=mode), dtype=np.uint8)


def resized_depth(depth: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Raw depth (h, w), or its validity, as `size`: the value of the nearest pixel."""
    return np.asarray(cv2.resize(depth, size[::-1], interpolation=cv2.INTER_NEAREST_EXACT))


def overlap_shares(extent: int, cells: int) -> NDArray[np.float64]:
    """(cells, extent): share of each of `cells` equal cells that each source cell covers."""
    edges = np.linspace(0, extent, cells + 1)
    source = np.arange(extent)
    low = np.maximum(edges[:-1, None], source[None])
    high = np.minimum(edges[1:, None], source[None] + 1)
    return np.maximum(high - low, 0.0) * cells / extent
