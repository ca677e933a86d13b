"""Adjustments by models of sensors: lens, exposure while the robot turns, steps of depth."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.adjustments.adjustment import Depth, ImageAdjustment, Images, Mask, Rgb

_RADII = np.linspace(0, 2, 8193)


def _distortion(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Images behind a lens: the radius r of a pixel becomes r (1 + value r^2), 1 in the corners.

    That is the first radial coefficient of OpenCV's model for square pixels and a focal length of
    half the diagonal. Where the lens sees beyond the image, RGB is black and depth is missing.
    """
    seen = np.zeros_like(rgb)
    columns, rows = _seen_pixels(rgb.shape[1], rgb.shape[2], value)
    for index, image in enumerate(rgb):
        cv2.remap(image, columns, rows, cv2.INTER_LINEAR, dst=seen[index])
    columns, rows = _seen_pixels(depth.shape[1], depth.shape[2], value)
    near = np.zeros_like(depth)
    for index, raw in enumerate(np.where(valid, depth, 0).astype(depth.dtype)):
        cv2.remap(raw, columns, rows, cv2.INTER_NEAREST, dst=near[index])
    return seen, near


@lru_cache(maxsize=4)
def _seen_pixels(
    height: int, width: int, value: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Column and row (height, width) that each pixel of a distorted image shows."""
    x = np.arange(width) - (width - 1) / 2
    y = np.arange(height)[:, None] - (height - 1) / 2
    distorted = np.hypot(x, y) / (np.hypot(width, height) / 2)
    stretched = _RADII * (1 + value * np.square(_RADII))
    end = int(np.argmax(stretched)) + 1  # beyond it, a negative value folds the image
    radii = np.interp(distorted, stretched[:end], _RADII[:end])
    scale = np.where(distorted > 0, radii / np.maximum(distorted, 1e-12), 1.0)
    columns, rows = scale * x + (width - 1) / 2, scale * y + (height - 1) / 2
    return columns.astype(np.float32), rows.astype(np.float32)


def _motion_blur(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """The mean of RGB along `value` + 1 pixels of a row, the outer two weighted by a fraction."""
    reach = int(np.ceil(value / 2))
    kernel = np.ones((1, 2 * reach + 1), dtype=np.float32)
    kernel[0, [0, -1]] = value / 2 - (reach - 1)
    kernel /= kernel.sum()
    blurred = np.empty_like(rgb)
    for index, image in enumerate(rgb):
        cv2.filter2D(image, -1, kernel, dst=blurred[index], borderType=cv2.BORDER_REPLICATE)
    return blurred, depth


def _rolling_shutter(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Rows of RGB moved to the right in proportion to their number, the middle one not at all."""
    height, width = rgb.shape[1:3]
    slope = value / max(height - 1, 1)
    shear = np.array([[1, slope, -slope * (height - 1) / 2], [0, 1, 0]])
    sheared = np.empty_like(rgb)
    for index, image in enumerate(rgb):
        cv2.warpAffine(
            image, shear, (width, height), dst=sheared[index], borderMode=cv2.BORDER_REPLICATE
        )
    return sheared, depth


def _depth_steps(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    """Valid depth rounded to levels, each of which is the one below times 1 + `value`."""
    step = np.log1p(value)
    levels = np.rint(np.log(np.maximum(depth, 1)) / step) * step
    rounded = np.clip(np.rint(np.exp(levels)), 1, np.iinfo(depth.dtype).max)
    return rgb, np.where(valid, rounded, depth).astype(depth.dtype)


DISTORTION = ImageAdjustment(
    "distortion", -0.14, 0.3, 0.0, 0.01, "share", "corners moved outwards by the lens",
    _distortion, moves_pixels=True,
)  # fmt: skip
MOTION_BLUR = ImageAdjustment(
    "motion_blur", 0.0, 32.0, 0.0, 0.5, "px", "blur along the rows, of a camera that turns",
    _motion_blur, image="rgb", in_pixels=True,
)  # fmt: skip
ROLLING_SHUTTER = ImageAdjustment(
    "rolling_shutter", -32.0, 32.0, 0.0, 0.5, "px",
    "last row ahead of the first, of a camera that turns", _rolling_shutter, image="rgb",
    in_pixels=True,
)  # fmt: skip
DEPTH_STEPS = ImageAdjustment(
    "depth_steps", 0.0, 0.2, 0.0, 0.005, "share", "steps of the valid depth, share of it",
    _depth_steps, image="depth",
)  # fmt: skip
