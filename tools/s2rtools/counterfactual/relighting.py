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

from s2rtools.counterfactual.light_grid import (
    cell_sums,
    largest_difference,
    lit_image,
    robust_weights,
    sliced,
    smoothed,
    unlit_image,
    weighted_moments,
)

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
        return unlit_image(np.ascontiguousarray(image), self.gain, self.slope, self.offset)


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
    source, target = np.ascontiguousarray(source), np.ascontiguousarray(target)
    cells, compared = _Cells(depth), np.flatnonzero(weight > 0)
    smooth_target = _blur(target)
    slope, offset = _affine(source, target, weight)
    residual = _residual(lit_image(source, slope, offset), smooth_target)
    slope, offset = _affine(
        source, target, robust_weights(weight, residual, _limit(residual, compared))
    )
    lit = lit_image(source, slope, offset)
    prior = PRIOR_SHARE * weight.size * ((lit * lit).reshape(-1, 3).mean(axis=0) + 100)
    image = lit
    for _ in range(ROUNDS):
        residual = _residual(image, smooth_target)
        weights = robust_weights(weight, residual, _limit(residual, compared))
        gain = cells.gains(lit, target, weights, prior)
        image = gain * lit
    np.clip(image, 0, 255, out=image)
    residual = _residual(image, smooth_target)
    return Relighting(image, residual, _median(residual, compared), gain, slope, offset)


class _Cells:
    """The cells of the grid that the pixels of one image fall into."""

    def __init__(self, depth: NDArray[np.float32]) -> None:
        height, width = depth.shape
        logs = np.log(np.maximum(depth, np.float32(0.1)))
        known = logs[depth > 0]
        low, high = np.percentile(known, (2, 98)) if known.size else (0.0, 1.0)
        position = (logs - np.float32(low)) / np.float32(
            max(float(high - low), 0.2) / (GRID[0] - 1)
        )
        self._level = np.clip(position, 0, np.float32(GRID[0] - 1))
        level = np.rint(self._level).astype(np.int32)
        rows = (np.arange(height) * GRID[1] // height)[:, None].astype(np.int32)
        cols = (np.arange(width) * GRID[2] // width)[None].astype(np.int32)
        self._cell = (level * GRID[1] + rows) * GRID[2] + cols

    def gains(
        self,
        lit: NDArray[np.float32],
        target: NDArray[np.float32],
        weights: NDArray[np.float32],
        prior: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Gains (h, w, 3) of least squares, pulled towards 1 where a cell holds little evidence.

        `prior` (3,) is the weight of the gain 1.
        """
        products, squares = cell_sums(self._cell, weights, lit, target, GRID)
        gains = (smoothed(products) + prior) / (smoothed(squares) + prior)
        return sliced(np.clip(gains, 0.2, 5.0).astype(np.float32), self._level)


def _affine(
    source: NDArray[np.float32], target: NDArray[np.float32], weights: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Slope and offset (3,) per channel of weighted least squares."""
    mean_s, mean_t, squares, products = weighted_moments(source, target, weights)
    variance, covariance = squares - mean_s * mean_s, products - mean_s * mean_t
    slope = np.clip((covariance + 25) / (variance + 25), 0.3, 3.0).astype(np.float32)
    return slope, (mean_t - slope * mean_s).astype(np.float32)


def _blur(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0))


def _residual(image: NDArray[np.float32], smooth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Largest absolute difference of the channels (h, w) to an image that is smoothed already."""
    return largest_difference(_blur(image), smooth)


def _median(residual: NDArray[np.float32], compared: NDArray[np.intp]) -> float:
    """Median of the residual (h, w) over pixels, by their flat indices; 0 for no pixels."""
    if not compared.size:
        return 0.0
    half = compared.size // 2
    values = np.partition(residual.take(compared), half)  # several times as fast as np.median
    upper = float(values[half])
    return upper if compared.size % 2 else (float(values[:half].max()) + upper) / 2


def _limit(residual: NDArray[np.float32], compared: NDArray[np.intp]) -> np.float32:
    """Residual from which a pixel counts little: 1.5 times the median, or `LEAST_SPREAD`."""
    return np.float32(max(1.5 * _median(residual, compared), LEAST_SPREAD))
