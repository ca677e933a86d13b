"""Standard errors under dependence: of neighbours in a recording, and inside trajectories.

Series are in recording order, one trajectory after the other. There are two standard errors:

- `series_spread`: the long-run variance of the series from its lowest cosine frequencies, after
  prewhitening by an autoregression of order 1 (HAR: heteroskedasticity and autocorrelation robust).
- `between_spread`: the variance between trajectories, as clusters.

Sources: Müller, "HAC corrections for strongly autocorrelated time series", Journal of Business and
Economic Statistics 32, 2014, and Lazarus, Lewis, Stock and Watson, "HAR inference", the same
journal 36, 2018 (cosines and their number); Andrews and Monahan, "An improved heteroskedasticity
and autocorrelation consistent covariance matrix estimator", Econometrica 60, 1992 (prewhitening);
Bell and McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage
samples", Survey Methodology 28, 2002 (few clusters).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special

from s2rstore.intervals.interval import FEWEST_TRAJECTORIES

Floats = NDArray[np.float64]
Codes = NDArray[np.integer]

_MAX_RHO = 0.97
_FEWEST_COSINES, _COSINES, _MOST_COSINES = 3, 0.2, 512
_MOST_ROWS = 1 << 15
"""Rows of a series that is transformed as it is; neighbours of longer ones are summed before."""
_SHORTEST_SERIES = 16
"""Rows below which a trajectory has no spread of its own and joins the others."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard error of a mean, and its degrees of freedom."""

    error: float
    freedom: float

    def critical(self, level: float) -> float:
        """Two-sided quantile of Student's distribution."""
        return float(special.stdtrit(self.freedom, 0.5 + level / 2))

    def half_width(self, level: float) -> float:
        return self.critical(level) * self.error


def trajectory_codes(trajectories: Codes | None, n: int) -> NDArray[np.intp]:
    """Codes 0, 1, ... of the trajectories of n rows; one trajectory where None.

    Raises ValueError where a trajectory is interrupted by another, or the sizes differ.
    """
    if trajectories is None:
        return np.zeros(n, dtype=np.intp)
    given = np.asarray(trajectories)
    if given.shape != (n,):
        raise ValueError(f"trajectories: expected shape ({n},), got {given.shape}")
    begins = np.ones(n, dtype=np.bool_)
    begins[1:] = given[1:] != given[:-1]
    if np.unique(given[begins]).size < np.count_nonzero(begins):
        raise ValueError("trajectories: the rows of a trajectory must follow each other")
    return np.asarray(np.cumsum(begins) - 1, dtype=np.intp)


def midranks(values: Floats) -> Floats:
    """Ranks 1 .. n, ties by their mean."""
    _, codes, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return np.asarray((last - (counts - 1) / 2)[codes], dtype=np.float64)


def normal_scores(values: Floats) -> Floats:
    """Normal quantiles of the midranks: a monotone transform to a nearly normal series."""
    return np.asarray(special.ndtri((midranks(values) - 0.5) / values.size), dtype=np.float64)


def autocorrelation(values: Floats, codes: NDArray[np.intp]) -> float:
    """Correlation of neighbours inside trajectories, corrected for its bias, in [0, 0.97].

    Fewer than `FEWEST_TRAJECTORIES` trajectories are centred one by one, as their levels are not
    part of what is estimated.
    """
    if values.size < 3:
        return 0.0
    deviations = values - _levels(values, codes)
    power = float(deviations @ deviations) / values.size
    if power == 0:
        return 0.0
    ends = np.flatnonzero(codes[1:] != codes[:-1])
    inside = values.size - 1 - ends.size
    product = deviations[1:] @ deviations[:-1] - deviations[ends + 1] @ deviations[ends]
    measured = float(product) / inside / power if inside else 0.0
    corrected = measured + (1 + 4 * max(measured, 0.0)) / values.size
    return float(np.clip(corrected, 0.0, _MAX_RHO))


def indicator_autocorrelation(rho: float) -> float:
    """Correlation of neighbours of the sign of a normal series with correlation `rho`."""
    return float(2 / np.pi * np.arcsin(rho))


def variance_inflation(rho: float, n: int) -> float:
    """n var(mean) / var of an autoregressive series of order 1."""
    if rho == 0:
        return 1.0
    return (1 + rho) / (1 - rho) - 2 * rho * (1 - rho**n) / (n * (1 - rho) ** 2)


def spreads(values: Floats, codes: NDArray[np.intp], rho: float) -> list[Spread]:
    """The standard errors of the mean of `values` (n,) that an interval has to cover.

    One of the series; from `FEWEST_TRAJECTORIES` trajectories on also the one between them.
    """
    count = int(codes[-1]) + 1 if values.size else 0
    if count < FEWEST_TRAJECTORIES:
        return [_pooled_spread(values, codes, rho)]
    return [series_spread(values, rho), between_spread(values, codes)]


def series_freedom(n: float) -> float:
    """Number of frequencies of the spread of a series of n rows, before it is rounded down."""
    return float(min(max(_FEWEST_COSINES, _COSINES * n ** (2 / 3)), max(n - 1, 1), _MOST_COSINES))


def series_spread(values: Floats, rho: float) -> Spread:
    """Standard error of the mean of one series (n,) from its lowest cosine frequencies."""
    n, count = values.size, int(series_freedom(values.size))
    frequencies = np.arange(1, count + 1)
    weights: Floats = fft.dct(_shortened(values), type=2)[1 : count + 1] / np.sqrt(2)
    shape = (1 - rho) ** 2 / (1 - 2 * rho * np.cos(np.pi * frequencies / n) + rho**2)
    return Spread(float(np.sqrt(np.mean(weights**2 / shape)) / n), float(count))


def _shortened(values: Floats) -> Floats:
    """The series with its mean removed, in sums of neighbours where it is long."""
    centred: Floats = values - values.mean()
    if values.size <= _MOST_ROWS:
        return centred
    starts = np.arange(_MOST_ROWS) * values.size // _MOST_ROWS
    sums: Floats = np.add.reduceat(centred, starts)
    return sums


def between_spread(values: Floats, codes: NDArray[np.intp]) -> Spread:
    """Standard error of the mean of `values` (n,) over trajectories as clusters."""
    sizes = np.bincount(codes)
    means, share = np.bincount(codes, values) / sizes, sizes / values.size
    error = float(np.sqrt((share**2 * (means - values.mean()) ** 2 / (1 - share)).sum()))
    scale = 1 / np.sqrt(1 - share)
    form = np.outer(scale, scale) * (np.diag(share) - np.outer(share, share))
    return Spread(error, float(np.trace(form) ** 2 / (form**2).sum()))


def _pooled_spread(values: Floats, codes: NDArray[np.intp], rho: float) -> Spread:
    """The spread of each trajectory around its own level, joined by Satterthwaite's freedom."""
    sizes = np.bincount(codes)
    if sizes.size == 1 or sizes.min() < _SHORTEST_SERIES:
        return series_spread(values, rho)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    parts = [series_spread(values[first:end], rho) for first, end in pairwise(starts)]
    share = sizes / values.size
    squares = np.array([part.error**2 for part in parts]) * share**2
    freedom = np.array([part.freedom for part in parts])
    total = float(squares.sum())
    if total == 0:
        return Spread(0.0, float(freedom.sum()))
    return Spread(float(np.sqrt(total)), float(total**2 / (squares**2 / freedom).sum()))


def _levels(values: Floats, codes: NDArray[np.intp]) -> Floats:
    count = int(codes[-1]) + 1
    if count >= FEWEST_TRAJECTORIES:
        return np.full(values.size, values.mean())
    return np.asarray((np.bincount(codes, values) / np.bincount(codes))[codes])
