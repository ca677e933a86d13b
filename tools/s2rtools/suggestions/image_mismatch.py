"""How much sim and real images of one pose differ: colours, depth, missing depth, depth noise.

Differences are taken between means over cells of the image, so that a moved edge of an object or
the noise of a pixel counts little, and enter a robust cost. The noise of depth is compared as a
statistic of the image, because another draw of it never agrees by pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain

Floats = NDArray[np.float64]
Channels = Literal["rgb", "depth", "rgbd"]
Images = tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.bool_]]
"""RGB (n, H, W, 3), depth (n, H, W) in metres and its validity (n, H, W)."""

CELLS = 16
_MISSING_CELLS = 4
_EDGES = (0.0, 1.5, 3.0, np.inf)
"""Depths in metres between which the noise is measured."""
LEAST_NOISE = 0.002
_SCALES = {"colour": 0.03, "depth": 0.05, "missing": 0.05, "noise": 0.3}
"""Differences that count as one: share of white, log of depth, share of pixels, log of noise."""
_LEAST_COVER = 0.25
_LEAST_PIXELS = 50


def metric(
    images: tuple[NDArray[np.uint8], NDArray[Any], NDArray[np.bool_]], domain: Domain
) -> Images:
    """Images of a domain with depth in metres in place of raw depth."""
    rgb, depth, valid = images
    return rgb, depth.astype(np.float32) * np.float32(domain.depth_scale), valid


def residuals(
    sim: Images, real: Images, channels: Channels = "rgbd", least_noise: float = LEAST_NOISE
) -> Floats:
    """Scaled differences (n, m) of n image pairs; equal images give zeros.

    The columns are those of `weights`. RGB and depth of a side may have different sizes. Relative
    noise of depth below `least_noise` counts little.
    """
    parts = []
    if channels != "depth":
        parts.append(_colours(sim[0]) - _colours(real[0]))
    if channels != "rgb":
        parts.append(_depth_ratio(sim, real))
        parts.append(_valid_shares(sim[2]) - _valid_shares(real[2]))
        noise = [_noise(*side[1:], least_noise) for side in (sim, real)]
        parts.append(noise[0] - noise[1])
    scales = [_SCALES[name] for name in _names(channels)]
    return np.concatenate([part / scale for part, scale in zip(parts, scales, strict=True)], axis=1)


def weights(channels: Channels = "rgbd", with_noise: bool = True) -> Floats:
    """Weights (m,) of the columns of `residuals`: equal ones for each kind of difference.

    Those of depth noise are 0 without it.
    """
    sizes = {"colour": 3 * CELLS**2, "depth": CELLS**2, "missing": _MISSING_CELLS**2,
             "noise": len(_EDGES) - 1}  # fmt: skip
    left_out = () if with_noise else ("noise",)
    return np.concatenate([
        np.full(sizes[name], 0.0 if name in left_out else 1 / sizes[name])
        for name in _names(channels)
    ])  # fmt: skip


def cost(difference: Floats, weight: Floats) -> Floats:
    """Robust cost (n,) of `residuals` (n, m): the weighted sum of sqrt(1 + r^2) - 1."""
    return np.asarray((np.sqrt(1 + np.square(difference)) - 1) @ weight)


def _names(channels: Channels) -> Sequence[str]:
    return {"rgb": ("colour",), "depth": ("depth", "missing", "noise")}.get(
        channels, tuple(_SCALES)
    )


def _cell_means(images: NDArray[Any], cells: int) -> Floats:
    """Means (n, cells, cells, ...) over equal cells of images (n, H, W, ...)."""
    size = cells, cells
    means = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    return np.asarray(means, dtype=np.float64)


def _colours(rgb: NDArray[np.uint8]) -> Floats:
    return _cell_means(rgb.astype(np.float32) / 255, CELLS).reshape(len(rgb), -1)


def _depth_ratio(sim: Images, real: Images) -> Floats:
    """Mean log of sim over real depth per cell; 0 where few pixels are valid on both sides."""
    both = sim[2] & real[2] & (sim[1] > 0) & (real[1] > 0)
    ratio = np.zeros(both.shape, dtype=np.float32)
    ratio[both] = np.log(sim[1][both] / real[1][both])
    share = _cell_means(both.astype(np.float32), CELLS)
    total = _cell_means(ratio, CELLS)
    means = np.where(share >= _LEAST_COVER, total / np.maximum(share, 1e-9), 0.0)
    return means.reshape(len(both), -1)


def _valid_shares(valid: NDArray[np.bool_]) -> Floats:
    """Share of valid pixels (n, cells) in each cell of masks (n, H, W)."""
    return _cell_means(valid.astype(np.float32), _MISSING_CELLS).reshape(len(valid), -1)


def _noise(depth: NDArray[np.float32], valid: NDArray[np.bool_], least: float) -> Floats:
    """Logarithm (n, 3) of the relative depth noise in three ranges of depth.

    Noise is the median difference of a pixel from the mean of its four neighbours. Ranges with few
    pixels count as noiseless.
    """
    centre = depth[:, 1:-1, 1:-1]
    around = (depth[:, :-2, 1:-1], depth[:, 2:, 1:-1], depth[:, 1:-1, :-2], depth[:, 1:-1, 2:])
    usable = valid[:, 1:-1, 1:-1] & (centre > 0)
    for rows in (valid[:, :-2, 1:-1], valid[:, 2:, 1:-1], valid[:, 1:-1, :-2], valid[:, 1:-1, 2:]):
        usable = usable & rows
    relative = np.abs(centre - sum(around) / 4) / np.maximum(centre, 1e-6)
    found = np.full((len(depth), len(_EDGES) - 1), least)
    for row in range(len(depth)):
        for column in range(len(_EDGES) - 1):
            inside = usable[row] & (centre[row] > _EDGES[column])
            inside &= centre[row] <= _EDGES[column + 1]
            if np.count_nonzero(inside) >= _LEAST_PIXELS:
                found[row, column] += float(np.median(relative[row][inside]))
    return np.log(found)
