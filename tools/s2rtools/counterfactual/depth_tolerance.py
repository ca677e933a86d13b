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
_SCALES, _SHIFTS = (0.8, 1.25), (-0.5, 0.5)
"""Plausible scales and shifts, metres, of a depth sensor."""


DepthPair = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Real depth and that of the sim surface in the same pixels (h, w), in metres, 0 if unknown."""


@dataclass(frozen=True, slots=True)
class DepthTolerance:
    """How the real sensor sees the sim surface at some depth, in metres.

    It returns shift + scale * depth on average, with a deviation of base + slope * depth^2, and a
    value only within `near` .. `far`.
    """

    base: float
    slope: float
    near: float
    far: float
    shift: float = 0.0
    scale: float = 1.0

    def expected(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """What the real sensor returns of a surface (h, w) on average; 0 where it is unknown."""
        found = np.float32(self.shift) + np.float32(self.scale) * depth
        return np.where(depth > 0, np.maximum(found, np.float32(0)), np.float32(0))

    def surface(self, measured: NDArray[np.float32]) -> NDArray[np.float32]:
        """The surface (h, w) that the real sensor measures on average; 0 where it has no value."""
        found = (measured - np.float32(self.shift)) / np.float32(self.scale)
        return np.where(measured > 0, np.maximum(found, np.float32(0)), np.float32(0))

    def deviation(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Deviation in metres of a value of the real sensor at depth (h, w) in metres."""
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

    In each of some ranges of depth, the median difference of both is taken, and 1.4826 times the
    median distance from the fitted mean, so that changed surfaces count little. Shift and scale,
    then base and slope are fitted to these. The range is that in which most pixels of the sim
    surface have a real value.
    """
    none = np.zeros(0, dtype=np.float32)
    real = np.concatenate([none, *(each.ravel() for each, _ in pairs)])
    sim = np.concatenate([none, *(each.ravel() for _, each in pairs)])
    known = sim > 0
    real, sim = real[known], sim[known]
    near, far = _returned_range(real, sim)
    measured = real > 0
    return _fit_noise(real[measured], sim[measured], near, far)


def _fit_noise(
    real: NDArray[np.float32], sim: NDArray[np.float32], near: float, far: float
) -> DepthTolerance:
    """Shift, scale, base and slope; a deviation of 5 cm without enough pixels."""
    if sim.size < _BINS * _LEAST_PIXELS:
        return DepthTolerance(0.05, 0.0, near, far)
    edges = np.quantile(sim, np.linspace(0, 1, _BINS + 1))
    which = np.clip(np.searchsorted(edges, sim, side="right") - 1, 0, _BINS - 1)
    groups = [np.flatnonzero(which == number) for number in range(_BINS)]
    groups = [rows for rows in groups if rows.size >= _LEAST_PIXELS]
    depths = np.array([np.median(sim[rows]) for rows in groups], dtype=np.float64)
    medians = np.array([np.median(real[rows] - sim[rows]) for rows in groups]) + depths
    scale, shift = np.polyfit(depths, medians, 1) if len(groups) > 1 else (1.0, 0.0)
    scale, shift = float(np.clip(scale, *_SCALES)), float(np.clip(shift, *_SHIFTS))
    off = np.abs(real - (np.float32(shift) + np.float32(scale) * sim))
    deviations = _MAD * np.array([np.median(off[rows]) for rows in groups])
    design = np.stack([np.ones_like(depths), np.square(depths)], axis=1)
    (base, slope), _ = nnls(design, deviations)
    return DepthTolerance(max(float(base), 0.01), float(slope), near, far, shift, scale)


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
