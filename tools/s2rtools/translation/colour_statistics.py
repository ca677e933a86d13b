"""Statistics of colours, colour spaces and linear maps of colours."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.translation.image_set import Rgb

Floats = NDArray[np.float64]

VARIANCE_FLOOR = 1.0
"""Variance added to every channel, in squared grey levels: limits the gain of flat images."""


def moments(colours: NDArray[np.uint8] | NDArray[np.float32]) -> Floats:
    """Moments (4, 3) of colours (..., 3) in grey levels: row 0 is the mean, rows 1 to 3 are the
    covariance, which divides by n."""
    pixels = colours.reshape(-1, 3)
    mean = pixels.mean(axis=0, dtype=np.float64)
    second = np.zeros((3, 3))
    for start in range(0, len(pixels), 1 << 20):
        block = pixels[start : start + (1 << 20)].astype(np.float64) - mean
        second += block.T @ block
    return np.vstack([mean, second / max(1, len(pixels))])


def transport(source: Floats, target: Floats, floor: float = VARIANCE_FLOOR) -> Floats:
    """Optimal transport between Gaussians with `moments` (4, 3): a matrix T (3, 3), symmetric and
    positive definite, with T S T = C for the covariances S and C.

    `floor` is added to the diagonal of both covariances. Source: Pitie and Kokaram, "The linear
    Monge-Kantorovitch linear colour mapping for example-based colour transfer", 2007.
    """
    root = _power(source[1:] + floor * np.eye(3), 0.5)
    inverse = np.linalg.inv(root)
    inner = _power(root @ (target[1:] + floor * np.eye(3)) @ root, 0.5)
    return np.asarray(inverse @ inner @ inverse)


def _power(matrix: Floats, exponent: float) -> Floats:
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.maximum(values, 1e-12) ** exponent) @ vectors.T)


def linear_map(rgb: Rgb, matrix: Floats, offset: Floats | float) -> Rgb:
    """matrix @ colour + offset of images (..., H, W, 3), rounded and clipped.

    OpenCV computes it in fixed point, so that a value may differ by one grey level from exact
    arithmetic.
    """
    affine = np.column_stack([matrix, np.broadcast_to(offset, 3)])
    rows = rgb.reshape(-1, rgb.shape[-2], 3)
    return np.asarray(cv2.transform(rows, affine)).reshape(rgb.shape)


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
