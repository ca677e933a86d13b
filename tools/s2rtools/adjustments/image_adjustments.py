"""Adjustments of existing images: colours, depth, and both at once."""

from __future__ import annotations

import zlib

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
    """Both images times 1 - value; 1 sets them to zero. Depth that is not valid becomes 0."""
    keep = 1.0 - value
    dark = np.rint(rgb * keep).astype(np.uint8)
    return dark, np.where(valid, np.rint(depth * keep), 0).astype(depth.dtype)


def _vignette(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Every channel times 1 - value * r^2, with r = 0 at the centre and 1 at the corners."""
    height, width = rgb.shape[1:3]
    x = (np.arange(width, dtype=np.float32) + 0.5) / width * 2 - 1
    y = (np.arange(height, dtype=np.float32) + 0.5) / height * 2 - 1
    gain = 1 - np.float32(value) * (x[None, :] ** 2 + y[:, None] ** 2) / 2
    return np.clip(np.rint(rgb * gain[..., None]), 0, 255).astype(np.uint8), depth


def _depth_noise(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Independent normal noise with a deviation of `value` times the depth, in valid pixels.

    The noise of an image is seeded by its content.
    """
    noisy = depth.copy()
    for index, raw in enumerate(depth):
        error = _content_noise(raw).standard_normal(raw.shape, dtype=np.float32)
        values = np.clip(np.rint(raw * (1 + value * error)), 1, np.iinfo(depth.dtype).max)
        noisy[index] = np.where(valid[index], values, raw).astype(depth.dtype)
    return rgb, noisy


def _depth_holes(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """The share `value` of the valid pixels loses its depth: those at steep depth, in patches.

    The patches of an image are seeded by its content.
    """
    missing = depth.copy()
    for index, raw in enumerate(depth):
        if not valid[index].any():
            continue
        metric = raw.astype(np.float32)
        slope = np.hypot(cv2.Sobel(metric, cv2.CV_32F, 1, 0), cv2.Sobel(metric, cv2.CV_32F, 0, 1))
        height, width = raw.shape
        coarse = _content_noise(raw).standard_normal(
            (height // 9 + 2, width // 9 + 2), dtype=np.float32
        )
        patches = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        rank = np.minimum(slope / np.maximum(metric, 1), 1) + 0.3 * patches
        limit = np.quantile(rank[valid[index]], 1 - value)
        missing[index][valid[index] & (rank > limit)] = 0
    return rgb, missing


def _content_noise(raw: Depth) -> np.random.Generator:
    return np.random.default_rng(zlib.crc32(np.ascontiguousarray(raw).tobytes()))


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
VIGNETTE = ImageAdjustment(
    "vignette", -0.5, 0.5, 0.0, 0.02, "share", "corners darker by the share", _vignette,
    image="rgb",
)  # fmt: skip
DEPTH_NOISE = ImageAdjustment(
    "depth_noise", 0.0, 0.2, 0.0, 0.005, "share", "noise of the valid depth, share of it",
    _depth_noise, image="depth",
)  # fmt: skip
DEPTH_HOLES = ImageAdjustment(
    "depth_holes", 0.0, 0.5, 0.0, 0.01, "share", "valid depth lost at edges and in patches",
    _depth_holes, image="depth",
)  # fmt: skip
