"""Noise of a real depth camera, measured from its images and added to simulated depth.

The model has three parts, each measured on the target and on the source, so that only the excess is
added: the spread of the high-frequency error in bins of depth, the share of pixels without a
return, and the largest depth that returns.
"""

from __future__ import annotations

import zlib
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.translation.method import Tensors

BINS = 8
NO_LIMIT = 1e4
"""Range in metres of a camera of which nothing is known."""
_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""
_LAPLACE_GAIN = np.sqrt(1.25)
"""Standard deviation of x minus the mean of its four neighbours, for independent unit noise."""

Depth = NDArray[Any]
Mask = NDArray[np.bool_]


class DepthNoise:
    """`edges` (BINS + 1,) of depth, `spread` (BINS,) and `max_depth` in raw units of the source.

    `hole_share` is the share of pixels that lose their return; they get the raw value `hole`.
    """

    def __init__(
        self,
        edges: NDArray[np.float64],
        spread: NDArray[np.float64],
        hole_share: float,
        max_depth: float,
        hole: float = 0.0,
    ) -> None:
        self.edges, self.spread = edges, spread
        self.hole_share, self.max_depth, self.hole = hole_share, max_depth, hole

    def apply(self, depth: Depth, valid: Mask, strength: float) -> Depth:
        """Degrade the valid pixels of raw depth (B, H, W).

        The noise of an image is seeded by its content, so the same image gives the same result.
        """
        degraded = depth.copy()
        for index, raw in enumerate(depth):
            rng = np.random.default_rng(zlib.crc32(np.ascontiguousarray(raw).tobytes()))
            exact = raw.astype(np.float64)
            level = np.clip(np.searchsorted(self.edges, exact) - 1, 0, BINS - 1)
            noisy = exact + strength * self.spread[level] * rng.standard_normal(raw.shape)
            limit = np.iinfo(raw.dtype).max if raw.dtype.kind == "u" else np.inf
            values = np.clip(np.rint(noisy), self.hole + 1, limit)
            values = np.where(self._holes(exact, valid[index], rng, strength), self.hole, values)
            degraded[index] = np.where(valid[index], values, raw).astype(raw.dtype)
        return degraded

    def _holes(
        self, depth: NDArray[np.float64], valid: Mask, rng: np.random.Generator, strength: float
    ) -> Mask:
        """Pixels beyond the range, and those with the steepest relative depth up to the share.

        The limit of the range falls with the strength, from the largest depth of the image to that
        of the camera.
        """
        farthest = max(self.max_depth, float(depth[valid].max(initial=0)))
        limit = strength * self.max_depth + (1 - strength) * farthest
        beyond = valid & (depth > limit)
        share = strength * self.hole_share
        if share <= 0 or not valid.any():
            return np.asarray(beyond)
        across = cv2.Sobel(depth, cv2.CV_64F, 1, 0)
        down = cv2.Sobel(depth, cv2.CV_64F, 0, 1)
        steepness = np.hypot(across, down) / np.maximum(depth, 1.0)
        steepness += 0.05 * cv2.GaussianBlur(rng.standard_normal(depth.shape), (0, 0), 2.0)
        threshold = np.quantile(steepness[valid], max(0.0, 1 - share))
        return np.asarray(beyond | (valid & (steepness > threshold)))

    def tensors(self) -> Tensors:
        figures = np.array([self.hole_share, self.max_depth, self.hole])
        return {"edges": self.edges, "spread": self.spread, "figures": figures}

    @classmethod
    def restore(cls, tensors: Tensors) -> DepthNoise:
        """Raises KeyError or ValueError where the tensors do not define a model."""
        hole_share, max_depth, hole = (float(value) for value in tensors["figures"].reshape(3))
        edges, spread = tensors["edges"].reshape(BINS + 1), tensors["spread"].reshape(BINS)
        if not 0 <= hole_share <= 1 or min(max_depth, hole, *spread, *np.diff(edges)) < 0:
            raise ValueError("figures of the depth noise are out of range")
        return cls(edges, spread, hole_share, max_depth, hole)


def measure(
    source: tuple[NDArray[np.float32], Mask],
    target: tuple[NDArray[np.float32], Mask],
    unit: float,
    hole: float = 0.0,
) -> DepthNoise:
    """Measure the excess noise of the target over the source.

    Both are depth in metres (N, H, W) with its validity; `unit` is the metres of one raw unit of
    the source, `hole` its raw value of pixels without a return. The spread is the root of the
    difference of variances, 0 where the source is noisier.
    """
    depth, valid = target
    returned = depth[valid]
    max_depth = float(np.quantile(returned, 0.999)) if returned.size else NO_LIMIT
    edges = np.zeros(BINS + 1)
    if returned.size:
        edges[:] = np.quantile(returned, np.linspace(0, 1, BINS + 1))
    edges += np.linspace(0, 1e-6, BINS + 1)
    noisy, clean = (_spread(*images, edges) for images in (target, source))
    spread = np.sqrt(np.maximum(noisy**2 - clean**2, 0))
    hole_share = float(max(0.0, source[1].mean() - valid.mean()))
    return DepthNoise(edges / unit, spread / unit, hole_share, max_depth / unit, hole)


def _spread(
    depth: NDArray[np.float32], valid: Mask, edges: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Robust deviation (BINS,) of depth minus the mean of its four neighbours, where all five are
    valid."""
    centre = depth[:, 1:-1, 1:-1]
    parts = (slice(0, -2), slice(1, -1)), (slice(2, None), slice(1, -1)), \
        (slice(1, -1), slice(0, -2)), (slice(1, -1), slice(2, None))  # fmt: skip
    mean = sum(depth[:, rows, columns] for rows, columns in parts) / 4
    usable = valid[:, 1:-1, 1:-1].copy()
    for rows, columns in parts:
        usable &= valid[:, rows, columns]
    residual, at = np.abs(centre - mean)[usable], centre[usable]
    level = np.clip(np.searchsorted(edges, at) - 1, 0, BINS - 1)
    return np.array(
        [
            _MAD * np.median(residual[level == b]) / _LAPLACE_GAIN if (level == b).any() else 0.0
            for b in range(BINS)
        ]
    )
