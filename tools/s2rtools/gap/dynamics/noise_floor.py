"""What the windows of a perfect simulator would show, because real poses are measured with noise.

Noise is what a pose lies off the cubic through its two neighbours on each side: white noise is
seen in full, slower errors (drift, filters) are not. Some of the motion lies off it as well, more
the coarser the poses: what every second pose shows beyond all is taken for motion, which is taken
off, so that the floor is rather too low than too high.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtools.gap.dynamics.windows import DriveWindows
from s2rtools.motion_logs.motion_log import Floats, Log

_KEPT = 0.95
_KEPT_SQUARES = 0.7589
"""Mean square of a standard normal value among the `_KEPT` smallest in size."""
_LEAST = 9
_GROWTH = 8.0
"""Smallest growth of the motion's own squares, less 1, from all poses to every second.

Measured of first-order motors (0.15 s): 30 and more from 8 Hz on, 14 at 4 Hz; slower poses are
refused (`evident`).
"""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations: `position` of the distance in m (x and y together), `heading` in rad.

    `motion` (m) is the part of what was seen of positions that may be motion, and was taken off.
    """

    position: float
    heading: float
    motion: float = 0.0

    def __str__(self) -> str:
        return f"{self.position:g} m, {self.heading:g} rad"


def of(log: Log) -> Noise:
    """White measurement noise of a log; 0 where it has fewer than 18 poses."""
    if log.time.size < 2 * _LEAST:
        return Noise(0.0, 0.0)
    columns = (log.x, log.y, np.unwrap(log.heading))
    fine, coarse = (
        np.array([_square(log.time[::k], column[::k]) for column in columns]) for k in (1, 2)
    )
    motion = np.minimum(np.maximum(coarse - fine, 0.0) / _GROWTH, fine)
    x, y, heading = fine - motion
    return Noise(float(np.sqrt(x + y)), float(np.sqrt(heading)), float(np.sqrt(motion[:2].sum())))


def squares(real: Log, made: DriveWindows, noise: Noise) -> Floats:
    """Mean square (H, K), m^2, of the windows' end errors if nothing but noise were in them.

    `made` are windows of `real`, whose poses have this `noise`; what the simulator's poses shake by
    is a gap. For noise n of the poses and v of the heading: sum of n^2
    + 2 D^2 (1 - exp(-v^2 / 2)), D the distance covered.
    """
    start = _share(real, made.starts)
    found = noise.position**2 * (start + _share(real, made.starts + made.lengths))
    found += 2 * made.distance**2 * -np.expm1(-(noise.heading**2) * start / 2)
    return np.where(np.isnan(made.end), np.nan, found)


def _square(time: Floats, values: Floats) -> float:
    """Mean square of what values lie off their neighbours, as that of single values."""
    weights = _neighbours(time)
    return _kept_square(_off(values, weights) / np.sqrt(1 + (weights**2).sum(axis=1)))


def _neighbours(time: Floats) -> Floats:
    """Lagrange weights (n - 4, 4) of the neighbours i - 2, i - 1, i + 1, i + 2 at time i."""
    at = np.stack([time[j : time.size - 4 + j] for j in (0, 1, 3, 4)], axis=1) - time[2:-2, None]
    weights = np.ones_like(at)
    for j in range(4):
        for k in range(4):
            if k != j:
                weights[:, j] *= -at[:, k] / (at[:, j] - at[:, k])
    return weights


def _off(values: Floats, weights: Floats) -> Floats:
    around = np.stack([values[j : values.size - 4 + j] for j in (0, 1, 3, 4)], axis=1)
    return np.asarray(values[2:-2] - (around * weights).sum(axis=1))


def _kept_square(off: Floats) -> float:
    """Mean square of normal values, from all but the largest: turns of the motion are no noise."""
    kept = np.sort(off**2)[: max(int(_KEPT * off.size), 1)]
    return float(kept.mean() / _KEPT_SQUARES)


def _share(log: Log, times: Floats) -> Floats:
    """How much of the noise's variance is left where a line between two poses is read."""
    right = np.clip(np.searchsorted(log.time, times), 1, log.time.size - 1)
    f = (times - log.time[right - 1]) / (log.time[right] - log.time[right - 1])
    f = np.clip(f, 0.0, 1.0)
    return np.asarray((1 - f) ** 2 + f**2)
