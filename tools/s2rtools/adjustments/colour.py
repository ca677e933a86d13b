"""Adjustments of the RGB image, by lookup tables over the 256 values of a channel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.adjustments.adjustment import ImageAdjustment, Images

_LEVELS = np.arange(256, dtype=np.float64)


def _table(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def _brightness(
    rgb: NDArray[np.uint8], depth: NDArray[Any], valid: NDArray[np.bool_], value: float
) -> Images:
    return _table(_LEVELS * value)[rgb], depth


def _contrast(
    rgb: NDArray[np.uint8], depth: NDArray[Any], valid: NDArray[np.bool_], value: float
) -> Images:
    """Contrast around each image's mean, which stays unchanged."""
    adjusted = np.empty_like(rgb)
    for index, image in enumerate(rgb):
        mean = float(image.mean())
        adjusted[index] = _table(mean + (_LEVELS - mean) * value)[image]
    return adjusted, depth


def _temperature(
    rgb: NDArray[np.uint8], depth: NDArray[Any], valid: NDArray[np.bool_], value: float
) -> Images:
    """Red times 1 + value / 2, blue times 1 - value / 2."""
    warm, cold = _table(_LEVELS * (1 + value / 2)), _table(_LEVELS * (1 - value / 2))
    return np.stack([warm[rgb[..., 0]], rgb[..., 1], cold[rgb[..., 2]]], axis=-1), depth


BRIGHTNESS = ImageAdjustment(
    "brightness", 0.0, 3.0, 1.0, 0.05, "factor", "every channel times the factor", _brightness
)
CONTRAST = ImageAdjustment(
    "contrast", 0.0, 3.0, 1.0, 0.05, "factor", "spread around the image's mean", _contrast
)
TEMPERATURE = ImageAdjustment(
    "temperature", -1.0, 1.0, 0.0, 0.05, "warmth", "more red and less blue", _temperature
)
