"""How far depth images of one surface differ by the sensor alone, estimated from pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

AGREEING = 2.2
CHANGED = 5.0
"""Multiples of the deviation up to which depths agree, and from which the surface changed."""
_BINS = 12
_LEAST_PIXELS = 50
_MAD = 1.4826


DepthPair = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Real depth and that of the sim surface in the same pixels (h, w), in metres, 0 if unknown."""


@dataclass(frozen=True, slots=True)
class DepthTolerance:
    """Deviation of the real depth from the sim surface: base + slope * depth^2, in metres.

    `near` and `far` are the range within which the real sensor returns a value.
    """

    base: float
    slope: float
    near: float
    far: float

    def deviation(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(np.float32(self.base) + np.float32(self.slope) * depth * depth)

    def agreeing(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Difference in metres up to which both depths show one surface."""
        return np.float32(AGREEING) * self.deviation(depth)

    def changed(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Difference in metres from which the surface changed."""
        return np.float32(CHANGED) * self.deviation(depth)

    def in_range(self, depth: NDArray[np.float32]) -> NDArray[np.bool_]:
        return (depth >= self.near) & (depth <= self.far)


def estimate_tolerance(pairs: Sequence[DepthPair]) -> DepthTolerance:
    """Estimate the tolerance from pairs of depth images.

    The deviation of
    each of some ranges of depth is 1.4826 times the median absolute difference from the median, so
    that changed surfaces count little; base and slope are fitted to these. The range is that in
    which most pixels of the sim surface have a real value.
    """
    none = np.zeros(0, dtype=np.float32)
    real = np.concatenate([none, *(each.ravel() for each, _ in pairs)])
    sim = np.concatenate([none, *(each.ravel() for _, each in pairs)])
    known = sim > 0
    real, sim = real[known], sim[known]
    near, far = _returned_range(real, sim)
    measured = real > 0
    base, slope = _fit_deviation(real[measured], sim[measured])
    return DepthTolerance(base, slope, near, far)


def _fit_deviation(real: NDArray[np.float32], sim: NDArray[np.float32]) -> tuple[float, float]:
    """Base and slope of the deviation; 5 cm without enough pixels."""
    if sim.size < _BINS * _LEAST_PIXELS:
        return 0.05, 0.0
    edges = np.quantile(sim, np.linspace(0, 1, _BINS + 1))
    which = np.clip(np.searchsorted(edges, sim, side="right") - 1, 0, _BINS - 1)
    depths, deviations = [], []
    for number in range(_BINS):
        off = (real - sim)[which == number]
        if off.size >= _LEAST_PIXELS:
            depths.append(float(np.median(sim[which == number])))
            deviations.append(_MAD * float(np.median(np.abs(off - np.median(off)))))
    squares = np.square(depths)
    design = np.stack([np.ones_like(squares), squares], axis=1)
    (base, slope), _ = nnls(design, np.array(deviations))
    return max(float(base), 0.01), float(slope)


def _returned_range(real: NDArray[np.float32], sim: NDArray[np.float32]) -> tuple[float, float]:
    """Nearest and farthest depth at which at least half of the sim surface has a real value."""
    if not sim.size:
        return 0.0, float("inf")
    edges = np.linspace(0, float(sim.max()) * 1.001, 81)
    total = np.histogram(sim, edges)[0]
    returned = np.histogram(sim[real > 0], edges)[0]
    judged = total >= _LEAST_PIXELS
    good = np.flatnonzero(judged & (returned >= 0.5 * total))
    if not good.size:
        return 0.0, float("inf")
    lacking = np.flatnonzero(judged & (returned < 0.5 * total))
    before, after = lacking[lacking < good[0]], lacking[lacking > good[-1]]
    near = float(edges[good[0]]) if before.size else 0.0
    far = float(edges[good[-1] + 1]) if after.size else float("inf")
    return near, far
