"""Colour statistics of image sets, and the choice between statistics of a domain and of an image.

Methods that match statistics take those of the source either from all images of the source domain
(`statistics=domain`: one fixed map, no flicker) or from the translated image itself
(`statistics=image`: follows changes of light, but also of what is in view).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.translation.image_set import Rgb

Floats = NDArray[np.float64]

STATISTICS = ("domain", "image")
VARIANCE_FLOOR = 1.0
"""Variance added to every channel, in squared grey levels: limits the gain of flat images."""


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Mean (3,) and covariance (3, 3) of colours in grey levels."""

    mean: Floats
    covariance: Floats


def moments(colours: NDArray[np.uint8] | NDArray[np.float32]) -> Moments:
    """Moments of colours (..., 3); the covariance divides by n."""
    pixels = colours.reshape(-1, 3)
    mean = pixels.mean(axis=0, dtype=np.float64)
    second = np.zeros((3, 3))
    for start in range(0, len(pixels), 1 << 20):
        block = pixels[start : start + (1 << 20)].astype(np.float64) - mean
        second += block.T @ block
    return Moments(mean, second / max(1, len(pixels)))


def to_lab(rgb: Rgb) -> NDArray[np.float32]:
    """CIE L*a*b* (..., 3) float32 of RGB images (B, H, W, 3)."""
    flat = rgb.reshape(-1, rgb.shape[2], 3).astype(np.float32) / 255
    return np.asarray(cv2.cvtColor(flat, cv2.COLOR_RGB2LAB)).reshape(rgb.shape)


def from_lab(lab: NDArray[np.float32]) -> Rgb:
    """RGB images (B, H, W, 3) uint8 of L*a*b* images."""
    flat = lab.reshape(-1, lab.shape[2], 3).astype(np.float32)
    return to_uint8(np.asarray(cv2.cvtColor(flat, cv2.COLOR_LAB2RGB)).reshape(lab.shape) * 255)


def to_uint8(values: NDArray[Any]) -> Rgb:
    """Round to grey levels and clip to 0 .. 255."""
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def linear_map(rgb: Rgb, matrix: Floats, offset: Floats | float) -> Rgb:
    """matrix @ colour + offset of images (..., H, W, 3), rounded and clipped.

    OpenCV computes it in fixed point, so that a value may differ by one grey level from exact
    arithmetic.
    """
    affine = np.column_stack([matrix, np.broadcast_to(offset, 3)])
    rows = rgb.reshape(-1, rgb.shape[-2], 3)
    return np.asarray(cv2.transform(rows, affine)).reshape(rgb.shape)


def statistics_option(options: Mapping[str, str]) -> str:
    """The option `statistics`. Raises RequestError for unknown values."""
    chosen = options.get("statistics", "domain")
    if chosen not in STATISTICS:
        raise RequestError(f"statistics={chosen}: one of {', '.join(STATISTICS)}")
    return chosen
