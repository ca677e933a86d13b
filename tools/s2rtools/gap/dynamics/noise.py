"""What the windows of a perfect simulator would show, because poses are measured with noise.

Noise is what a pose lies off the cubic through its two neighbours on each side: white noise is
seen in full, slower errors (drift, filters) are not, so that the floor is rather too low than too
high; with few poses per manoeuvre some of the motion is taken for noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rstore import angles
from s2rtools.gap.dynamics.windows import Plan, Windows
from s2rtools.logs.contract import Floats, Log

_KEPT = 0.95
_KEPT_SQUARES = 0.7589
"""Mean square of a standard normal value among the `_KEPT` smallest in size."""
_LEAST = 9


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations: `position` of the distance in m (x and y together), `heading` in rad."""

    position: float
    heading: float


def of(log: Log) -> Noise:
    """White measurement noise of a log; 0 where it has fewer than 9 poses."""
    if log.time.size < _LEAST:
        return Noise(0.0, 0.0)
    weights = _neighbours(log.time)
    size = np.sqrt(1 + (weights**2).sum(axis=1))
    x, y = (_deviation(_off(column, weights) / size) for column in (log.x, log.y))
    heading = _deviation(angles.wrap(_off(np.unwrap(log.heading), weights)) / size)
    return Noise(float(np.hypot(x, y)), heading)


def squares(real: Log, sim: Log, made: Windows, plan: Plan) -> Floats:
    """Mean square (H, K), m^2, of the windows' end errors if nothing but noise were between them.

    `made` are the windows of `real` and `sim`. For noise n of both poses and v of both headings:
    sum of n^2 + 2 D^2 (1 - exp(-v^2 / 2)), D the distance covered.
    """
    found = np.zeros(made.end.shape)
    turned = np.zeros(made.starts.size)
    horizons = np.round(np.array(plan.horizons) * plan.rate) / plan.rate
    for log in (real, sim):
        noise = of(log)
        start = _share(log, made.starts)
        turned += noise.heading**2 * start
        for row, horizon in enumerate(horizons):
            found[row] += noise.position**2 * (start + _share(log, made.starts + horizon))
    found += 2 * made.distance**2 * -np.expm1(-turned / 2)
    return np.where(np.isnan(made.end), np.nan, found)


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


def _deviation(off: Floats) -> float:
    """Of normal values, from all but the largest: turns of the motion are no noise."""
    kept = np.sort(off**2)[: max(int(_KEPT * off.size), 1)]
    return float(np.sqrt(kept.mean() / _KEPT_SQUARES))


def _share(log: Log, times: Floats) -> Floats:
    """How much of the noise's variance is left where a line between two poses is read."""
    right = np.clip(np.searchsorted(log.time, times), 1, log.time.size - 1)
    f = (times - log.time[right - 1]) / (log.time[right] - log.time[right - 1])
    f = np.clip(f, 0.0, 1.0)
    return np.asarray((1 - f) ** 2 + f**2)
