"""Intervals of real figures that simulated errors narrow: prediction-powered inference.

Real errors are known for a few paired instances; the sim errors of these, and of further instances
that only simulation has, cost nothing. The estimate is

    mean over pairs of (real - weight * sim) + weight * mean of sim over the simulated instances.

It is unbiased for any weight that does not depend on the rows it is applied to, so that each of
five folds has the weight that minimises the variance over the other four. A weight of 0 gives the
interval of the real errors alone. How much narrower the interval gets depends on the correlation
of real and sim errors alone.

Source: Angelopoulos, Bates, Fannjiang, Jordan and Zrnic, "Prediction-powered inference", Science
382, 2023; Angelopoulos, Duchi and Zrnic, "PPI++: efficient prediction-powered inference", 2023
(the weight); Zrnic and Candes, "Cross-prediction-powered inference", PNAS 121, 2024 (folds).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import estimates
from s2rstore.intervals.dependence import (
    Codes,
    Floats,
    Spread,
    autocorrelation,
    spreads,
    trajectory_codes,
)
from s2rstore.intervals.interval import LEVEL, Interval, Sample, finite

MIN_PAIRS = 100
"""Fewest pairs of an interval with simulation: of fewer, the weight is not known well enough."""
FOLDS = 5
BLOCKS = (5, 10)
"""Fewest and most neighbours whose means are compared for the exchange rate.

Single rows hide what neighbours share, and short blocks what residuals share over longer
distances: blocks are as long as leaves `_ENOUGH_BLOCKS`.
"""
_ENOUGH_BLOCKS = 20
_FEWEST_BLOCKS = 12
"""Fewest blocks of neighbours of an exchange rate with an interval."""
_DETERMINED = 1e-9
"""Share of the variance that remains where simulation determines the real figure."""
_UNLIKE_LEVEL = 0.999
"""Level at which the means of the pairs and of the simulated instances must not differ."""
_SYMMETRIC_RATE = 1.1
"""Exchange rate from which on the intervals of a mean do not rely on the skewness of errors."""
_NO_ERROR = Spread(0.0, 1.0)
_NOISE = 2.0
"""Sampling variance of a correlation near 0, in that of independent rows."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """Sim errors of the instances that have no real image.

    errors (N,) in recording order; trajectories (N,) group them, None where they are independent.
    """

    errors: Floats
    trajectories: Codes | None = None

    @classmethod
    def none(cls) -> Simulated:
        return cls(np.empty(0))


@dataclass(frozen=True, slots=True)
class WithSimulation:
    """A figure of reality by the real images alone and with simulation.

    rate: the exchange rate, how many real images one real image is worth beside unlimited simulated
    ones; 1 where simulation tells nothing. correlation: rank correlation of the real and the
    simulated figure over the pairs. weight: mean of the folds' weights. n: pairs. simulated:
    instances without real image.
    """

    real_only: Interval
    combined: Interval
    rate: Interval
    correlation: Interval
    weight: float
    n: int
    simulated: int

    @property
    def effective_images(self) -> float:
        """Number of real images alone that would give an interval as narrow; NaN if unknown."""
        alone, combined = (each.high - each.low for each in (self.real_only, self.combined))
        return (
            self.n * (alone / combined) ** 2 if math.isfinite(alone) and combined > 0 else math.nan
        )

    def as_json(self) -> dict[str, Any]:
        """The figure as JSON data; unknown numbers are null."""
        return {
            "real_only": self.real_only.as_json(),
            "with_simulation": self.combined.as_json(),
            "exchange_rate": self.rate.as_json(),
            "correlation": self.correlation.as_json(),
            "weight": finite(self.weight),
            "effective_images": finite(self.effective_images),
            "pairs": self.n,
            "simulated": self.simulated,
        }


def mean(
    real: Floats, sim: Floats, simulated: Simulated, trajectories: Codes | None = None, *,
    level: float = LEVEL,
) -> WithSimulation:  # fmt: skip
    """Mean of `real` (n,), whose `sim` (n,) are of the same instances in recording order."""
    alone = estimates.mean(real, trajectories, level=level)
    adjusted = _adjust(real, sim, simulated, trajectories, level)
    return adjusted.result(alone, lambda: adjusted.mean(level) if alone.is_known else alone)


def difference(
    real: Floats, sim: Floats, simulated: Simulated, trajectories: Codes | None = None
) -> WithSimulation:
    """Mean of paired differences `real` (n,) of two runs; `sim` and `simulated` in simulation."""
    alone = estimates.paired_difference(real, trajectories)
    adjusted = _adjust(real, sim, simulated, trajectories, LEVEL)
    return adjusted.result(alone, lambda: adjusted.mean(LEVEL, symmetric=True))


def proportion(
    real: NDArray[np.bool_], sim: NDArray[np.bool_], simulated: Simulated,
    trajectories: Codes | None = None, *, errors: Floats | None = None, level: float = LEVEL,
) -> WithSimulation:  # fmt: skip
    """Share of hits `real` (n,); `sim` (n,) and `simulated` are the hits in simulation.

    `errors` (n,) as in `estimates.proportion`. The interval is Wilson's, whose number of
    independent rows grows by the ratio of the variances.
    """
    alone = estimates.proportion(real, trajectories, errors=errors, level=level)
    hits, predicted = (np.asarray(each, dtype=np.float64) for each in (real, sim))
    adjusted = _adjust(hits, predicted, simulated, trajectories, level)
    return adjusted.result(alone, lambda: _wilson(alone, adjusted, level))


def median(
    real: Floats, sim: Floats, simulated: Simulated, trajectories: Codes | None = None, *,
    level: float = LEVEL,
) -> WithSimulation:  # fmt: skip
    """Median of `real` (n,), bounded by order statistics of the real errors.

    Simulation predicts whether a real error is below the median, by the rank of the sim error among
    all sim errors.
    """
    every = np.sort(np.concatenate([sim, simulated.errors]))

    def larger(errors: Floats) -> Floats:
        """Share of all sim errors that are at least as large, (n,)."""
        return np.asarray(1.0 - np.searchsorted(every, errors) / max(every.size, 1))

    below = (real <= np.median(real)).astype(np.float64)
    drawn = replace(simulated, errors=larger(simulated.errors))
    adjusted = _adjust(below, larger(sim), drawn, trajectories, level)
    return adjusted.result(
        estimates.median(real, trajectories, level=level), lambda: _ranked(real, adjusted, level)
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Adjusted:
    """The series (n,) whose mean is the estimate with simulation.

    shift: what simulation adds to the mean of the real figure. ratio: the smallest estimate of
    the variance of the real mean in that of the estimate. simulated: standard error of the
    weighted mean of the simulated instances. reason: why there is no interval, or empty.
    """

    values: Floats
    codes: NDArray[np.intp]
    count: int
    rate: Interval
    correlation: Interval
    weight: float = 0.0
    shift: float = 0.0
    ratio: float = 1.0
    simulated: Spread = _NO_ERROR
    reason: str = ""

    def result(self, alone: Interval, combine: Callable[[], Interval]) -> WithSimulation:
        if self.reason:
            combined = Interval.unknown(alone.value, self.reason)
        else:
            combined = combine() if self.count else alone
        return WithSimulation(alone, combined, self.rate, self.correlation, self.weight,
                              self.values.size, self.count)  # fmt: skip

    def mean(self, level: float, symmetric: bool = False) -> Interval:
        """The interval of the mean of the series, with the error of the simulated mean added.

        It is also that of a `symmetric` series where simulation explains a part of the values: the
        skewness of what remains has no known sign.
        """
        symmetric = symmetric or self.rate.value > _SYMMETRIC_RATE
        estimate = estimates.paired_difference if symmetric else estimates.mean
        interval = estimate(self.values, self.codes, level=level)
        if not interval.is_known:
            return interval
        half = self.simulated.half_width(level)
        low = interval.value - math.hypot(interval.value - interval.low, half)
        high = interval.value + math.hypot(interval.high - interval.value, half)
        return replace(interval, low=low, high=high)

    def parts(self) -> list[Spread]:
        """The standard errors of the mean of the series that an interval has to cover."""
        return spreads(self.values, self.codes, autocorrelation(self.values, self.codes))


def _adjust(
    real: Floats, sim: Floats, simulated: Simulated, trajectories: Codes | None, level: float
) -> _Adjusted:
    real, sim = np.asarray(real, np.float64), np.asarray(sim, np.float64)
    if real.shape != sim.shape:
        raise ValueError(f"real and sim: expected one shape, got {real.shape} and {sim.shape}")
    codes, count = trajectory_codes(trajectories, real.size), simulated.errors.size
    reason = _refused(real, sim)
    correlation = estimates.spearman(real, sim, trajectories, level=level)
    if reason:
        rate = Interval.unknown(reason=reason)
        return _Adjusted(real, codes, count, rate, correlation, reason=reason)
    folds = _folds(codes)
    residual = real - _weights(real, sim, folds, math.inf, shrinks=False) * (sim - sim.mean())
    rate = _rate(real, residual, codes, correlation, level)
    if not count:
        return _Adjusted(real, codes, 0, rate, correlation)
    error = _standard_error(simulated)
    reason = _unlike(sim, codes, simulated.errors, error)
    if reason:
        return _Adjusted(real, codes, count, rate, correlation, reason=reason)
    weights = _weights(real, sim, folds, count / real.size)
    moved = weights * (sim - simulated.errors.mean())
    extra = Spread(float(weights.mean()) * error, max(count - 1.0, 1.0))
    values = real - moved
    return _Adjusted(
        values, codes, count, rate, correlation, float(weights.mean()), -float(moved.mean()),
        _variance_ratio(real, values, codes, extra.error), extra,
    )  # fmt: skip


def _refused(real: Floats, sim: Floats) -> str:
    if real.size < MIN_PAIRS:
        return f"n {real.size}, an interval with simulation needs {MIN_PAIRS} pairs"
    if not (np.isfinite(real).all() and np.isfinite(sim).all()):
        return "a value is infinite or missing"
    if real.min() == real.max():
        return "all real values are equal"
    return "all simulated values are equal" if sim.min() == sim.max() else ""


def _folds(codes: NDArray[np.intp]) -> NDArray[np.intp]:
    """Fold (n,) of each row: neighbours, and whole trajectories where there are enough."""
    place = np.arange(codes.size, dtype=np.float64)
    if int(codes[-1]) + 1 >= FOLDS:
        place = (np.searchsorted(codes, codes) + np.searchsorted(codes, codes, "right") - 1) / 2
    return np.asarray(place * FOLDS // codes.size, dtype=np.intp)


def _weights(
    real: Floats, sim: Floats, folds: NDArray[np.intp], ratio: float, shrinks: bool = True
) -> Floats:
    """Weight (n,) of each row from the rows of other folds; `ratio`: simulated per real image.

    Where it `shrinks`, a weight that is mostly noise is made smaller.
    """
    weights = np.zeros(real.size)
    for fold in np.unique(folds):
        others = folds != fold
        if not others.any():
            continue
        a, b = real[others] - real[others].mean(), sim[others] - sim[others].mean()
        variance = float(b @ b)
        if variance > 0:
            best = float(a @ b) / variance / (1 + 1 / ratio)
            weights[folds == fold] = max(best, 0.0) * (_shrinkage(a, b) if shrinks else 1.0)
    return weights


def _shrinkage(a: Floats, b: Floats) -> float:
    """Factor 0 .. 1 of a weight from centred series (n,), small where it is mostly noise.

    Source: the positive part of James and Stein, "Estimation with quadratic loss", 1961, for a
    squared correlation, with a sampling variance of `_NOISE` / n for dependent rows.
    """
    explained = float(a @ b) ** 2
    noise = _NOISE / a.size * (float(a @ a) * float(b @ b) - explained)
    return max(0.0, 1.0 - noise / explained) if explained > 0 else 0.0


def _standard_error(simulated: Simulated) -> float:
    """Standard error of the mean of the simulated instances."""
    values, codes = simulated.errors, simulated.trajectories
    if values.size < 2:
        return math.inf
    if codes is None:
        return float(values.std(ddof=1) / math.sqrt(values.size))
    known = trajectory_codes(codes, values.size)
    return max(part.error for part in spreads(values, known, autocorrelation(values, known)))


def _unlike(sim: Floats, codes: NDArray[np.intp], simulated: Floats, error: float) -> str:
    """Why the simulated instances do not stand for the same poses as the pairs; else empty."""
    parts = spreads(sim, codes, autocorrelation(sim, codes))
    paired = max(part.half_width(_UNLIKE_LEVEL) for part in parts)
    further = Spread(error, max(simulated.size - 1.0, 1.0)).half_width(_UNLIKE_LEVEL)
    if abs(float(sim.mean() - simulated.mean())) <= math.hypot(paired, further):
        return ""
    return "the sim errors of the simulated instances are unlike those of the pairs"


def _variance_ratio(real: Floats, values: Floats, codes: NDArray[np.intp], extra: float) -> float:
    """Variance of the mean of `real` (n,) in that with simulation, of the adjusted `values` (n,).

    The smaller one of two estimates: from the series, whose spread from low frequencies is joined
    with that of its rows because either is noisy, and from its trajectories. `extra` is the
    standard error of the simulated mean.
    """
    alone, adjusted = (spreads(each, codes, autocorrelation(each, codes))
                       for each in (real, values))  # fmt: skip
    pairs = [(a.error**2, b.error**2) for a, b in zip(alone, adjusted, strict=True)]
    rows = pairs[0][0] * float(values.var() / real.var())
    ratios = [a / max(b + extra**2, 1e-12 * a) for a, b in [(pairs[0][0], rows), *pairs] if a > 0]
    joined = math.sqrt(ratios[0] * ratios[1]) if len(ratios) > 1 else 1.0
    return min([joined, *ratios[2:]])


def _rate(
    real: Floats, residual: Floats, codes: NDArray[np.intp], correlation: Interval, level: float
) -> Interval:
    """Variance of `real` (n,) in that of the `residual` (n,), among means of blocks of neighbours.

    The interval is by the influence of a block on the logarithm of the ratio. It holds the rates of
    all correlations up to the upper bound of the `correlation`, which rows that share little tell
    better.
    """
    blocks, owners = _blocks(codes)
    sizes = np.bincount(blocks)
    a, b = (np.square(np.bincount(blocks, each - each.mean()) / sizes) for each in (real, residual))
    if not b.mean() > _DETERMINED * a.mean():
        return Interval.unknown(math.inf, "simulation determines the real figure")
    if sizes.size < _FEWEST_BLOCKS:
        reason = f"{sizes.size} blocks of neighbours, an exchange rate needs"
        return Interval.unknown(float(a.mean() / b.mean()), f"{reason} {_FEWEST_BLOCKS}")
    if np.array_equal(real, residual):  # no weight helps
        high = _rate_of(correlation.high) if correlation.is_known else 1.0
        return Interval(1.0, 1.0, high, level)
    found = estimates.linear(
        float(np.log(a.mean() / b.mean())), a / a.mean() - b / b.mean(), owners, level=level,
        minimum=_FEWEST_BLOCKS,
    )  # fmt: skip
    low, value, high = (math.exp(x) for x in (found.low, found.value, found.high))
    if found.is_known and correlation.is_known:
        high = max(high, _rate_of(correlation.high))
    return Interval(low, value, high, level, found.reason).at_least(1.0)


def _rate_of(correlation: float) -> float:
    """The exchange rate of independent rows with a correlation; 1 for a negative one."""
    return 1 / max(1 - max(correlation, 0.0) ** 2, 1e-6)


def _blocks(codes: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Block (n,) of each row inside its trajectory, and the trajectory of each block."""
    starts = np.searchsorted(codes, codes)
    sizes = np.bincount(codes)[codes]
    inside = np.arange(codes.size) - starts
    length = _block_length(np.bincount(codes))
    place = inside * np.maximum(sizes // length, 1) // sizes
    begins = (np.diff(codes, prepend=-1) != 0) | (np.diff(place, prepend=-1) != 0)
    return np.cumsum(begins) - 1, codes[begins]


def _block_length(sizes: NDArray[np.intp]) -> int:
    """The longest blocks of which trajectories of these `sizes` have enough."""
    shortest, longest = BLOCKS
    for length in range(longest, shortest, -1):
        if int(np.maximum(sizes // length, 1).sum()) >= _ENOUGH_BLOCKS:
            return length
    return shortest


def _wilson(alone: Interval, adjusted: _Adjusted, level: float) -> Interval:
    """Wilson's interval of the adjusted share, with the number of independent rows it has."""
    if not alone.is_known or alone.sample is None:
        return alone
    p = min(max(alone.value + adjusted.shift, 0.0), 1.0)
    effective = max(alone.sample.effective_n * adjusted.ratio, 1.0)
    t = max(part.critical(level) for part in adjusted.parts())
    low, high = estimates.wilson_bounds(p, effective, t)
    sample = Sample(alone.sample.n, effective, alone.sample.trajectories)
    return Interval(low, p, high, level, sample=sample)


def _ranked(real: Floats, adjusted: _Adjusted, level: float) -> Interval:
    """The median that the adjusted shares below it give, bounded by order statistics."""
    ordered, n = np.sort(real), real.size
    half = math.hypot(max(part.half_width(level) for part in adjusted.parts()),
                      adjusted.simulated.half_width(level))  # fmt: skip
    middle = min(max(0.5 - adjusted.shift, 0.0), 1.0)
    value = float(np.quantile(ordered, middle))
    low, high = math.floor((middle - half) * n + 1e-9), math.ceil((middle + half) * n - 1e-9) + 1
    error = max(part.error for part in adjusted.parts())
    effective = 0.25 / (error**2 + adjusted.simulated.error**2)
    return Interval(
        float(ordered[low - 1]) if low >= 1 else -math.inf, value,
        float(ordered[high - 1]) if high <= n else math.inf, level,
        ends=(float(ordered[0]), float(ordered[-1])),
        sample=Sample(n, effective, int(adjusted.codes[-1]) + 1),
    )  # fmt: skip
