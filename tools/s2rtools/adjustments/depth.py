"""Adjustments of the depth image; invalid pixels stay unchanged."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.adjustments.adjustment import ImageAdjustment, Images


def _depth_range(
    rgb: NDArray[np.uint8], depth: NDArray[Any], valid: NDArray[np.bool_], value: float
) -> Images:
    """Valid depth times the factor, within the type's range."""
    scaled = np.clip(np.rint(depth * value), 0, np.iinfo(depth.dtype).max)
    return rgb, np.where(valid, scaled, depth).astype(depth.dtype)


def _depth_blur(
    rgb: NDArray[np.uint8], depth: NDArray[Any], valid: NDArray[np.bool_], value: float
) -> Images:
    """Gaussian blur over the valid pixels only."""
    blurred = np.empty_like(depth)
    for index in range(len(depth)):
        weight = valid[index].astype(np.float32)
        total = cv2.GaussianBlur(depth[index] * weight, (0, 0), value)
        share = cv2.GaussianBlur(weight, (0, 0), value)
        smooth = np.rint(total / np.maximum(share, 1e-6))
        blurred[index] = np.where(valid[index], smooth, depth[index]).astype(depth.dtype)
    return rgb, blurred


DEPTH_RANGE = ImageAdjustment(
    "depth_range", 0.25, 4.0, 1.0, 0.05, "factor", "valid depth times the factor", _depth_range
)
DEPTH_BLUR = ImageAdjustment(
    "depth_blur", 0.0, 16.0, 0.0, 0.5, "px", "blur of the valid depth, sigma", _depth_blur
)
