"""Relight an image to another of the same scene: local gains that ignore changed content.

The gains vary smoothly over columns, rows and the logarithm of depth, as in the bilateral grid of
Chen, Paris and Durand, "Real-time edge-aware image processing with the bilateral grid", 2007. They
are fitted by iteratively reweighted least squares, so that pixels whose content differs count
little.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

GRID = (6, 8, 8)
"""Cells along log depth, rows and columns."""
ROUNDS = 3
PRIOR_SHARE = 20 / 128**2
"""Weight of the gain 1 in each cell, in pixels of mean brightness as a share of the image."""
LEAST_SPREAD = 4.0
"""Grey levels of residual that always count as fitting."""


@dataclass(frozen=True, slots=True, eq=False)
class Relighting:
    """A relit image and how it was made.

    `image` (h, w, 3) float32 levels 0 .. 255; `residual` (h, w) absolute difference to the other
    image in levels, smoothed; `spread` its median. The image is `gain` * (`slope` * source +
    `offset`), with gains (h, w, 3).
    """

    image: NDArray[np.float32]
    residual: NDArray[np.float32]
    spread: float
    gain: NDArray[np.float32]
    slope: NDArray[np.float32]
    offset: NDArray[np.float32]

    def applied(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Another image (h, w, 3) of the same view under the fitted light."""
        return np.clip(self.gain * (self.slope * image + self.offset), 0, 255)

    def removed(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """The image (h, w, 3) with the fitted light taken out of it."""
        return np.clip((image / self.gain - self.offset) / self.slope, 0, 255)


def relight(
    source: NDArray[np.float32],
    target: NDArray[np.float32],
    depth: NDArray[np.float32],
    weight: NDArray[np.float32],
) -> Relighting:
    """Fit the light of `target` to `source`, both (h, w, 3) float32 levels of one view.

    `depth` (h, w) in metres, 0 where unknown; `weight` (h, w) is the confidence that both images
    show the same content, 0 where they cannot be compared.
    """
    levels = _Cells(depth)
    smooth_target = _blur(target)
    slope, offset = _affine(source, target, weight)
    lit = slope * source + offset
    weights = weight * _robust_weights(_residual(lit, smooth_target), weight)
    slope, offset = _affine(source, target, weights)
    lit = slope * source + offset
    gain = np.ones_like(lit)
    for _ in range(ROUNDS):
        weights = weight * _robust_weights(_residual(gain * lit, smooth_target), weight)
        gain = levels.gains(lit, target, weights)
    image = np.clip(gain * lit, 0, 255)
    residual = _residual(image, smooth_target)
    return Relighting(image, residual, _median(residual, weight), gain, slope, offset)


class _Cells:
    """The cells of the grid that the pixels of one image fall into."""

    def __init__(self, depth: NDArray[np.float32]) -> None:
        height, width = depth.shape
        self._shape = (height, width)
        logs = np.log(np.maximum(depth, 0.1))
        known = logs[depth > 0]
        low, high = np.percentile(known, (2, 98)) if known.size else (0.0, 1.0)
        position = (logs - low) / max(float(high - low), 0.2) * (GRID[0] - 1)
        self._level = np.clip(position, 0, GRID[0] - 1).astype(np.float32)
        level = np.rint(self._level).astype(np.intp)
        rows = (np.arange(height) * GRID[1] // height)[:, None]
        cols = (np.arange(width) * GRID[2] // width)[None]
        self._cell = ((level * GRID[1] + rows) * GRID[2] + cols).ravel()

    def gains(
        self, lit: NDArray[np.float32], target: NDArray[np.float32], weights: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Gains (h, w, 3) of least squares, pulled towards 1 where a cell holds little evidence."""
        size, flat = int(np.prod(GRID)), weights.ravel()
        products, squares = (self._sums(flat, lit, other, size) for other in (target, lit))
        prior = PRIOR_SHARE * flat.size * ((lit * lit).mean(axis=(0, 1)) + 100)
        gains = (_smooth_grid(products) + prior) / (_smooth_grid(squares) + prior)
        return self._sliced(np.clip(gains, 0.2, 5.0).astype(np.float32))

    def _sums(
        self,
        weights: NDArray[np.float32],
        a: NDArray[np.float32],
        b: NDArray[np.float32],
        size: int,
    ) -> NDArray[np.float64]:
        """Sums of weights * a * b over the pixels of each cell, (*GRID, 3)."""
        product = (a * b).reshape(-1, 3)
        sums = [np.bincount(self._cell, weights * product[:, c], size) for c in range(3)]
        return np.stack(sums, axis=-1).reshape(*GRID, 3).astype(np.float64)

    def _sliced(self, gains: NDArray[np.float32]) -> NDArray[np.float32]:
        """The grid's values at the pixels, linear along each axis, (h, w, 3)."""
        height, width = self._shape
        planes = np.stack([
            cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) for plane in gains
        ])  # fmt: skip
        low = np.minimum(self._level.astype(np.intp), GRID[0] - 2)
        share = (self._level - low)[..., None]
        rows, cols = np.ogrid[:height, :width]
        return np.asarray(
            planes[low, rows, cols] * (1 - share) + planes[low + 1, rows, cols] * share
        )


def _smooth_grid(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights 1 2 1 along each of the first three axes."""
    for axis in range(3):
        padded = np.concatenate([grid.take([0], axis), grid, grid.take([-1], axis)], axis=axis)
        count = grid.shape[axis]
        before, after = (padded.take(range(k, k + count), axis) for k in (0, 2))
        grid = (before + 2 * grid + after) / 4
    return grid


def _affine(
    source: NDArray[np.float32], target: NDArray[np.float32], weights: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Slope and offset (3,) per channel of weighted least squares."""
    total = max(float(weights.sum()), 1e-6)
    w = weights[..., None] / np.float32(total)
    mean_s, mean_t = (w * source).sum(axis=(0, 1)), (w * target).sum(axis=(0, 1))
    centred = source - mean_s
    variance = (w * centred * centred).sum(axis=(0, 1))
    covariance = (w * centred * (target - mean_t)).sum(axis=(0, 1))
    slope = np.clip((covariance + 25) / (variance + 25), 0.3, 3.0).astype(np.float32)
    return slope, (mean_t - slope * mean_s).astype(np.float32)


def _blur(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0))


def _residual(image: NDArray[np.float32], smooth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Largest absolute difference of the channels (h, w) to an image that is smoothed already."""
    return np.asarray(np.abs(_blur(image) - smooth).max(axis=2))


def _median(residual: NDArray[np.float32], weight: NDArray[np.float32]) -> float:
    compared = residual[weight > 0]
    return float(np.median(compared)) if compared.size else 0.0


def _robust_weights(
    residual: NDArray[np.float32], weight: NDArray[np.float32]
) -> NDArray[np.float32]:
    """1 / (1 + (residual / t)^4), with t at least the median residual times 1.5."""
    limit = np.float32(max(1.5 * _median(residual, weight), LEAST_SPREAD))
    return np.asarray(1 / (1 + (residual / limit) ** 4), dtype=np.float32)
