"""Structure of images that does not depend on their colours: edges, layout, local explanation.

All functions take images (N, h, w, 3) uint8 or one image (h, w, 3). Lengths in pixels are given for
a longer edge of `REFERENCE_EDGE` pixels and scale with the image.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.translation.image_set import Rgb

Floats = NDArray[np.float64]
Plane = NDArray[np.float32]

REFERENCE_EDGE = 160
LUMINANCE = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of R, G, B in the luminance, ITU-R BT.601."""
GREY_FLOOR = 4.0
"""Grey levels of contrast below which an image counts as flat."""
BLUR = 1.5
"""Pixels: smoothing of the luminance with which a blur of the image is explained."""
SQUARE_SCALE = 64.0
"""Grey levels by which squared luminance is divided, so that its size is that of the channels."""
GRID = 16
"""Rows and columns of a layout descriptor."""


def luminance(rgb: Rgb) -> Plane:
    """Luminance (..., h, w) in grey levels."""
    return np.asarray(rgb.astype(np.float32) @ LUMINANCE)


def scaled(pixels: float, shape: tuple[int, ...]) -> float:
    """A length for images of `shape` (h, w, ...)."""
    return pixels * max(shape[0], shape[1]) / REFERENCE_EDGE


def smoothed(image: Plane, sigma: float) -> Plane:
    """Gaussian filter of (h, w) or (h, w, C)."""
    if sigma <= 0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101))


def tensor_components(rgb: Rgb, sigma: float, window: float) -> Plane:
    """Structure tensor summed over the channels: (h, w, 3) with xx, yy, xy.

    Gradients are those of the image smoothed with `sigma`; products are averaged with a Gaussian
    of `window`. The tensor ignores the sign of an edge and in which channel it lies.
    """
    image = smoothed(rgb.astype(np.float32), sigma)
    dx = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=0.125, borderType=cv2.BORDER_REFLECT_101)
    dy = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3, scale=0.125, borderType=cv2.BORDER_REFLECT_101)
    products = np.stack([(dx * dx).sum(-1), (dy * dy).sum(-1), (dx * dy).sum(-1)], axis=-1)
    return smoothed(products, window)


def edge_strength(rgb: Rgb, sigma: float = 1.0) -> Plane:
    """Root of the trace of the structure tensor, (h, w), grey levels per pixel."""
    tensor = tensor_components(rgb, sigma, 1.0)
    return np.sqrt(np.maximum(tensor[..., 0] + tensor[..., 1], 0))


def edge_field(rgb: Rgb) -> Plane:
    """Strength and orientation of edges, (h, w, 3).

    The first plane is the strength minus its mean; the others are the strength times the cosine
    and the sine of twice the angle, so that opposite gradients count as the same edge.
    """
    tensor = tensor_components(rgb, scaled(1.0, rgb.shape), scaled(1.0, rgb.shape))
    trace = tensor[..., 0] + tensor[..., 1]
    strength = np.sqrt(np.maximum(trace, 0))
    inverse = 1 / np.maximum(strength, 1e-6)
    return np.stack(
        [
            strength - strength.mean(),
            (tensor[..., 0] - tensor[..., 1]) * inverse,
            2 * tensor[..., 2] * inverse,
        ],
        axis=-1,
    )


def layout_descriptor(rgb: Rgb) -> Floats:
    """Edge field on a grid of `GRID` x `GRID` cells, as a vector of unit length.

    An image without edges gives a vector close to zero.
    """
    field = cv2.resize(edge_field(rgb), (GRID, GRID), interpolation=cv2.INTER_AREA)
    vector = field.astype(np.float64).ravel()
    return np.asarray(vector / np.hypot(np.linalg.norm(vector), 0.02 * GREY_FLOOR * GRID))


def standardised_thumbnail(rgb: Rgb) -> Floats:
    """Luminance on a grid of `GRID` x `GRID` cells, minus its mean, over its contrast.

    `GREY_FLOOR` is added to the contrast, so that a flat image gives values close to zero.
    """
    small = cv2.resize(luminance(rgb), (GRID, GRID), interpolation=cv2.INTER_AREA)
    values = small.astype(np.float64).ravel()
    return np.asarray((values - values.mean()) / np.hypot(values.std(), GREY_FLOOR))


def unexplained_variance(explaining: Rgb, explained: Rgb, window: float) -> tuple[Plane, Plane]:
    """Local variance of `explained` that no affine map of the colours of `explaining` gives.

    Around every pixel the three channels of one image are regressed on those of the other, on its
    smoothed luminance and on its squared luminance, with Gaussian weights of `window` pixels: the
    smoothed luminance explains a blur, the squared one a steep curve. Returns the residual variance
    and the total variance, both summed over the channels, (h, w), squared grey levels. The
    regression is that of the guided filter: He, Sun and Tang, "Guided image filtering", 2013.
    """
    grey = luminance(explaining)
    blurred = smoothed(grey, scaled(BLUR, explaining.shape))
    squared = (grey - grey.mean()) ** 2 / SQUARE_SCALE
    x = _centred(np.concatenate([explaining, blurred[..., None], squared[..., None]], axis=-1))
    y = _centred(explained)
    mean_x, mean_y = smoothed(x, window), smoothed(y, window)
    xx = _products(x, x, window) - mean_x[..., :, None] * mean_x[..., None, :]
    xy = _products(x, y, window) - mean_x[..., :, None] * mean_y[..., None, :]
    # A variance of one squared grey level, so that flat windows explain nothing.
    solution = np.linalg.solve(xx.astype(np.float64) + np.eye(x.shape[-1]), xy)
    total = np.maximum(smoothed(y * y, window) - mean_y**2, 0).sum(axis=-1)
    residual = np.clip(total - (solution * xy).sum(axis=(-2, -1)), 0, total)
    return residual.astype(np.float32), total


def _centred(image: NDArray[Any]) -> Plane:
    """The image as float32 minus its mean: float32 keeps seven digits of the products."""
    values = image.astype(np.float32)
    return values - values.mean(axis=(0, 1))


def _products(a: Plane, b: Plane, window: float) -> Plane:
    """Local means of every channel of `a` (h, w, A) times every one of `b`, (h, w, A, B)."""
    columns = [smoothed(a * b[..., k : k + 1], window) for k in range(b.shape[-1])]
    return np.stack(columns, axis=-1)
