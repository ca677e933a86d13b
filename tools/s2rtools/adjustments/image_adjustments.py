"""Adjustments of existing images: colours, depth, and both at once."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.adjustments.adjustment import Depth, ImageAdjustment, Images, Mask, Rgb

_LEVELS = np.arange(256, dtype=np.float64)


def _table(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def _brightness(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    return _table(_LEVELS * value)[rgb], depth


def _contrast(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Contrast around each image's mean, which stays unchanged."""
    adjusted = np.empty_like(rgb)
    for index, image in enumerate(rgb):
        mean = float(image.mean())
        adjusted[index] = _table(mean + (_LEVELS - mean) * value)[image]
    return adjusted, depth


def _temperature(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Red times 1 + value / 2, blue times 1 - value / 2."""
    warm, cold = _table(_LEVELS * (1 + value / 2)), _table(_LEVELS * (1 - value / 2))
    return np.stack([warm[rgb[..., 0]], rgb[..., 1], cold[rgb[..., 2]]], axis=-1), depth


def _depth_range(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Valid depth times the factor, within the type's range."""
    scaled = np.clip(np.rint(depth * value), 0, np.iinfo(depth.dtype).max)
    return rgb, np.where(valid, scaled, depth).astype(depth.dtype)


def _depth_blur(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Gaussian blur over the valid pixels only."""
    blurred = np.empty_like(depth)
    for index in range(len(depth)):
        weight = valid[index].astype(np.float32)
        total = cv2.GaussianBlur(depth[index] * weight, (0, 0), value)
        share = cv2.GaussianBlur(weight, (0, 0), value)
        smooth = np.rint(total / np.maximum(share, 1e-6))
        blurred[index] = np.where(valid[index], smooth, depth[index]).astype(depth.dtype)
    return rgb, blurred


def _black(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Both images times 1 - value; 1 sets them to zero."""
    keep = 1.0 - value
    dark = np.rint(rgb * keep).astype(np.uint8)
    return dark, np.rint(depth * keep).astype(depth.dtype)


BRIGHTNESS = ImageAdjustment(
    "brightness", 0.0, 3.0, 1.0, 0.05, "factor", "every channel times the factor", _brightness,
    image="rgb",
)  # fmt: skip
CONTRAST = ImageAdjustment(
    "contrast", 0.0, 3.0, 1.0, 0.05, "factor", "spread around the image's mean", _contrast,
    image="rgb",
)  # fmt: skip
TEMPERATURE = ImageAdjustment(
    "temperature", -1.0, 1.0, 0.0, 0.05, "warmth", "more red and less blue", _temperature,
    image="rgb",
)  # fmt: skip
DEPTH_RANGE = ImageAdjustment(
    "depth_range", 0.25, 4.0, 1.0, 0.05, "factor", "valid depth times the factor", _depth_range,
    image="depth",
)  # fmt: skip
DEPTH_BLUR = ImageAdjustment(
    "depth_blur", 0.0, 16.0, 0.0, 0.5, "px", "blur of the valid depth, sigma", _depth_blur,
    image="depth", in_pixels=True,
)  # fmt: skip
BLACK = ImageAdjustment(
    "black", 0.0, 1.0, 0.0, 0.05, "share", "share of RGB and depth removed", _black
)
