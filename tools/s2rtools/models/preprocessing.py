"""Convert stored frames to a network's input."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

DEPTH_LIMIT = 10.0
"""Metres that map to +1; depth 0 maps to -1."""


def preprocess(
    rgb: NDArray[Any], depth: NDArray[Any], depth_scale: float, input_size: tuple[int, int]
) -> NDArray[np.float32]:
    """rgb (B, H, W, 3) and raw depth (B, H, W) -> (B, 4, h, w) in [-1, 1], RGB then depth.

    RGB / 127.5 - 1; metres = raw * `depth_scale`, clipped at `DEPTH_LIMIT`. Frames of another size
    are resized in their own dtype first.
    """
    rgb, depth = resize_frames(rgb, depth, input_size)
    x = np.empty((len(rgb), 4, *input_size), dtype=np.float32)
    planes = np.moveaxis(rgb, -1, 1)
    np.multiply(planes, np.float32(1 / 127.5), out=x[:, :3], dtype=np.float32)
    np.multiply(depth, np.float32(2 * depth_scale / DEPTH_LIMIT), out=x[:, 3], dtype=np.float32)
    np.minimum(x[:, 3], np.float32(2), out=x[:, 3])
    x -= np.float32(1)
    return x


def resize_frames(
    rgb: NDArray[np.uint8], depth: NDArray[Any], size: tuple[int, int]
) -> tuple[NDArray[np.uint8], NDArray[Any]]:
    """Resize both images of a batch to (h, w); arrays of that size are returned unchanged."""
    return _resize(rgb, size), _resize(depth, size)


def _resize(images: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    if images.shape[1:3] == size:
        return images
    height, width = size
    out = np.empty((len(images), height, width, *images.shape[3:]), dtype=images.dtype)
    grows = images.shape[1] < height or images.shape[2] < width
    method = cv2.INTER_LINEAR if grows else cv2.INTER_AREA
    for source, target in zip(images, out, strict=True):
        cv2.resize(np.ascontiguousarray(source), (width, height), dst=target, interpolation=method)
    return out
