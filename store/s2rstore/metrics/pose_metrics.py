"""Figures that stand beside every summary: ranks, accuracy, baseline and bootstrap intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles

LOSS_GAMMA = 0.3
LEVEL = 0.95
"""Of every interval that is shown."""
LEVEL_TOLD = f"{100 * LEVEL:g} %"


@dataclass(frozen=True, slots=True)
class Bootstrap:
    """Block bootstrap settings; `block_length` 0 means the rounded-up square root of n."""

    block_length: int = 0
    replicates: int = 1000
    seed: int = 20210101
    level: float = LEVEL


BOOTSTRAP = Bootstrap()


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with the bounds of its bootstrap interval."""

    value: float
    low: float
    high: float


def bounds(replicates: NDArray[np.float64], level: float = LEVEL) -> tuple[float, float]:
    """The percentile interval of replicates (R,); NaN where there is none, or one is NaN."""
    if not replicates.size:
        return np.nan, np.nan
    tail = 50 * (1 - level)
    low, high = np.percentile(replicates, [tail, 100 - tail])
    return float(low), float(high)


def interval(value: float, replicates: NDArray[np.float64], level: float = LEVEL) -> Interval:
    """An estimate with the percentile interval of its replicates (R,)."""
    return Interval(float(value), *bounds(replicates, level))


def position_error(
    x: NDArray[np.float64], y: NDArray[np.float64], x0: NDArray[np.float64], y0: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance in metres, elementwise."""
    return np.asarray(np.hypot(x - x0, y - y0), dtype=np.float64)


def pose_loss(
    error: NDArray[np.float64], heading_error: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(1 - g) error^2 + g heading_error with g = 0.3 (Sim2RealViz, eq. 1), m^2 and rad."""
    return (1 - LOSS_GAMMA) * error**2 + LOSS_GAMMA * heading_error


def heading_error(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """|wrap(a - b)|, radians in [0, pi]."""
    return angles.distance(a, b)


def accuracy(error: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """max(0, 1 - error / scale), both in metres."""
    return np.maximum(0.0, 1.0 - error / scale)


def rank(error: NDArray[np.float64]) -> NDArray[np.int32]:
    """1 for the smallest error, ties by index; 0 where the error is NaN."""
    ranks = np.zeros(error.size, dtype=np.int32)
    known = np.flatnonzero(~np.isnan(error))
    ranks[known[np.argsort(error[known], kind="stable")]] = np.arange(1, known.size + 1)
    return ranks


def baseline_accuracy(
    x: NDArray[np.float64], y: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    """Accuracy of the constant prediction of the mean position, per instance, shape (n,)."""
    if x.size == 0:
        return np.zeros(0)
    return accuracy(np.hypot(x - x.mean(), y - y.mean()), scale)


def bootstrap_mean(values: NDArray[np.float64], settings: Bootstrap = BOOTSTRAP) -> Interval:
    """Mean with its percentile interval by circular blocks of neighbouring values.

    `values` (n,) are in recording order, without NaN. NaN bounds below two values. Deviations from
    the mean are widened by sqrt(b / (b - 1)), b the number of blocks, because b blocks know no more
    than b values. Source: Politis and Romano, "A circular block-resampling procedure for stationary
    data", 1992.
    """
    n = values.size
    if n == 0:
        return Interval(np.nan, np.nan, np.nan)
    mean = float(values.mean())
    if n == 1:
        return Interval(mean, np.nan, np.nan)
    length = min(settings.block_length or int(np.ceil(np.sqrt(n))), n // 2)
    blocks = -(-n // length)
    around = np.concatenate([[0.0], np.cumsum(np.concatenate([values, values[: length - 1]]))])
    sums = around[length:] - around[:-length]
    rng = np.random.default_rng(settings.seed)
    starts = rng.integers(0, n, size=(settings.replicates, blocks))
    means = sums[starts].sum(axis=1) / (blocks * length)
    means = mean + (means - mean) * np.sqrt(blocks / (blocks - 1))
    return interval(mean, means, settings.level)
