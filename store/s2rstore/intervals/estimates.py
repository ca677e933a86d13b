"""Confidence intervals of means, quantiles, proportions and correlations under dependence.

Each function takes values in recording order and the trajectories they are from, and returns an
`Interval`, or an estimate without bounds and the reason. Values of several trajectories must be
grouped by trajectory. NaN values are left out.

What an interval is about depends on the number of trajectories: fewer than three describe
themselves alone, three or more also trajectories like them.

The recipe per quantity was chosen by simulation; `python -m bench intervals` measures its coverage.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import special

from s2rstore.intervals.dependence import (
    Codes,
    Floats,
    Spread,
    autocorrelation,
    indicator_autocorrelation,
    midranks,
    normal_scores,
    spreads,
    trajectory_codes,
    variance_inflation,
)
from s2rstore.intervals.interval import (
    FEWEST_TRAJECTORIES,
    LEVEL,
    MIN_DIFFERENCE,
    MIN_MEAN,
    MIN_MEDIAN,
    MIN_POPULATION_MEAN,
    MIN_SHARE,
    Interval,
    Sample,
)

_MAX_SKEWNESS = 2.0
_MOST_RANKED = 50_000
"""Values that are ranked to measure their dependence; more take too long to sort."""
_MOST_INVERTED = 20_000
"""Rows up to which the bounds of a ratio are found by inversion; of more, it is nearly linear."""
_DOUBLINGS, _HALVINGS = 12, 8
_FISHER = 1.03
"""Factor of the standard error of Fisher's z for a rank correlation."""


def mean(
    values: Floats, trajectories: Codes | None = None, *, level: float = LEVEL,
    minimum: int = MIN_MEAN,
) -> Interval:  # fmt: skip
    """Mean of `values` (n,), such as errors, corrected for their skewness.

    Failures that are so rare that a recording holds none widen no interval: `minimum` is the number
    of values from which on that is unlikely, `MIN_POPULATION_MEAN` of three or more trajectories;
    `MIN_DIFFERENCE` will do for differences and for scores in a range. Source: Hall, "On the
    removal of skewness by transformation", Journal of the Royal Statistical Society B 54, 1992.
    """
    return _mean(values, trajectories, level, minimum, "a mean")


def paired_difference(
    differences: Floats, trajectories: Codes | None = None, *, level: float = LEVEL
) -> Interval:
    """Mean of the `differences` (n,) of two measurements of the same instances.

    The interval joins that of `mean` and the one without its correction, because the skewness of
    differences has no known sign. Differences that are all 0 have the bounds 0 and 0.
    """
    known, codes = _known(differences, trajectories)
    if known.size >= MIN_DIFFERENCE and not known.any():
        return Interval(0.0, 0.0, 0.0, level, sample=Sample(known.size, known.size, _count(codes)))
    return _mean(differences, trajectories, level, MIN_DIFFERENCE, "a mean difference", True)


def _mean(
    values: Floats,
    trajectories: Codes | None,
    level: float,
    minimum: int,
    figure: str,
    symmetric: bool = False,
) -> Interval:
    values, codes = _known(values, trajectories)
    value = float(values.mean()) if values.size else np.nan
    if minimum == MIN_MEAN and values.size and _count(codes) >= FEWEST_TRAJECTORIES:
        minimum, figure = MIN_POPULATION_MEAN, f"{figure} of {_count(codes)} trajectories"
    reason = _too_few(values, minimum, figure) or _no_spread(values)
    if reason:
        return Interval.unknown(value, reason)
    parts = spreads(values, codes, _latent_autocorrelation(values, codes))
    asymmetry = [skewness(values) * parts[0].error / float(values.std())]
    if len(parts) > 1:
        means = np.bincount(codes, values) / np.bincount(codes)
        asymmetry.append(max(skewness(means), 0.0) / np.sqrt(means.size))
    ends = [skewed_bounds(value, part, g, level) for part, g in zip(parts, asymmetry, strict=True)]
    if symmetric:
        halves = [part.half_width(level) for part in parts]
        ends += [(value - half, value + half) for half in halves]
    low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    return Interval(low, value, high, level, sample=_sample(values, codes, parts))


def stratified_mean(values: Floats) -> Interval:
    """Mean of `values` (n,), one from each of n strata of equal size, similar strata side by side.

    The variance is that of the differences of neighbours, which is not too small where strata
    differ; the bounds are corrected for skewness as in `mean`. Source: Wolter, "Introduction to
    variance estimation", 2007, section 8.2.
    """
    values, _ = _known(values, None)
    value = float(values.mean()) if values.size else np.nan
    reason = _too_few(values, MIN_MEAN, "a mean") or _no_spread(values)
    if reason:
        return Interval.unknown(value, reason)
    n = values.size
    variance = float(np.square(np.diff(values)).sum()) / (2 * (n - 1))
    part = Spread(np.sqrt(variance / n), 2 * (n - 1) ** 2 / (3 * n - 4))
    g = skewness(values) * part.error / float(values.std())
    low, high = skewed_bounds(value, part, g, LEVEL)
    effective = float(values.var() / part.error**2) if part.error else float(n)
    return Interval(low, value, high, sample=Sample(n, effective, 1))


def linear(
    value: float, influence: Floats, trajectories: Codes | None = None, *, level: float = LEVEL,
    minimum: int = MIN_DIFFERENCE,
) -> Interval:  # fmt: skip
    """A statistic with the estimate `value` from the influence (n,) that each row has on it.

    The influence of a row is the derivative of the statistic by the row's weight, so that the
    statistic varies as the mean of the influences does.
    """
    influence, codes = _known(influence, trajectories)
    reason = _too_few(influence, minimum, "this figure") or _no_spread(influence)
    if reason:
        return Interval.unknown(value, reason)
    parts = spreads(influence, codes, autocorrelation(influence, codes))
    half = max(part.half_width(level) for part in parts)
    return Interval(value - half, value, value + half, level,
                    sample=_sample(influence, codes, parts))  # fmt: skip


def ratio_of_means(
    numerators: Floats, denominators: Floats, trajectories: Codes | None = None, *,
    level: float = LEVEL, minimum: int = MIN_DIFFERENCE,
) -> Interval:  # fmt: skip
    """Mean of `numerators` (n,) over the mean of `denominators` (n,), errors of the same instances.

    The bounds are the ratios r beyond which the mean of numerators - r * denominators is known not
    to be 0 by `paired_difference`; of very many rows, those of the linearised ratio. Rows without
    one of both values are left out. Source: Fieller, "Some problems in interval estimation",
    Journal of the Royal Statistical Society B 16, 1954.
    """
    known = ~(np.isnan(numerators) | np.isnan(denominators))
    above, below = numerators[known], denominators[known]
    codes = None if trajectories is None else np.asarray(trajectories)[known]
    mean_below = float(below.mean()) if below.size else 0.0
    if not mean_below > 0:
        return Interval.unknown(math.nan, "the mean of the denominators is not above 0")
    value = float(above.mean()) / mean_below

    def difference(ratio: float) -> Interval:
        return _mean(above - ratio * below, codes, level, minimum, "a mean", symmetric=True)

    linearised = difference(value)
    if not linearised.is_known:
        return Interval.unknown(value, linearised.reason)
    offsets = [(end - linearised.value) / mean_below for end in (linearised.low, linearised.high)]
    if above.size <= _MOST_INVERTED:
        offsets = [_furthest(lambda at: difference(value + at), offset) for offset in offsets]
    low, high = (value + offset for offset in offsets)
    return Interval(low, value, high, level, sample=linearised.sample)


def _furthest(difference: Callable[[float], Interval], offset: float) -> float:
    """The offset from the ratio, in the direction of `offset`, from which 0 is excluded."""
    inside, outside = 0.0, offset
    for _ in range(_DOUBLINGS):
        if difference(outside).excludes_zero:
            break
        inside, outside = outside, 2 * outside
    else:
        return math.copysign(math.inf, offset)
    for _ in range(_HALVINGS):
        middle = (inside + outside) / 2
        inside, outside = (
            (inside, middle) if difference(middle).excludes_zero else (middle, outside)
        )
    return outside


def median(values: Floats, trajectories: Codes | None = None, *, level: float = LEVEL) -> Interval:
    """Median of `values` (n,); see `quantile`."""
    return quantile(values, 0.5, trajectories, level=level)


def quantile(
    values: Floats, q: float, trajectories: Codes | None = None, *, level: float = LEVEL
) -> Interval:
    """Quantile of `values` (n,), bounded by order statistics.

    A bound whose rank lies outside the values is infinite. Source: Woodruff, "Confidence intervals
    for medians and other position measures", Journal of the American Statistical Association 47,
    1952.
    """
    values, codes = _known(values, trajectories)
    value = _quantile(values, q) if values.size else np.nan
    reason = _too_few(values, MIN_MEDIAN, "a median" if q == 0.5 else "a quantile")
    if reason:
        return Interval.unknown(value, reason)
    ordered = np.sort(values)
    return ranked_quantile(values, value, q, codes, lambda rank: float(ordered[rank - 1]), level)


def ranked_quantile(
    values: Floats, value: float, q: float, trajectories: Codes,
    ranked: Callable[[int], float], level: float = LEVEL,
) -> Interval:  # fmt: skip
    """The interval of `quantile` for at least `MIN_MEDIAN` values (n,) that are sorted elsewhere.

    `value` is their quantile, and `ranked` gives the value of a rank 1 .. n.
    """
    codes, n = trajectory_codes(trajectories, values.size), values.size
    below = (values <= value).astype(np.float64)
    rho = indicator_autocorrelation(_latent_autocorrelation(values, codes))
    parts = spreads(below, codes, rho)
    half = max(part.half_width(level) for part in parts)
    low, high = int(np.floor((q - half) * n + 1e-9)), int(np.ceil((q + half) * n - 1e-9)) + 1
    return Interval(
        ranked(low) if low >= 1 else -np.inf, value, ranked(high) if high <= n else np.inf, level,
        ends=(ranked(1), ranked(n)), sample=_sample(below, codes, parts),
    )  # fmt: skip


def proportion(
    hits: NDArray[np.bool_], trajectories: Codes | None = None, *,
    errors: Floats | None = None, level: float = LEVEL,
) -> Interval:  # fmt: skip
    """Share of `hits` (n,), by Wilson's interval with the effective number of rows.

    `errors` (n,) are the values that a threshold cut into hits, whose dependence is known better
    than that of the hits; where a row has none (NaN), it counts as the largest. Source: Wilson,
    "Probable inference", Journal of the American Statistical Association 22, 1927; Korn and
    Graubard, "Confidence intervals for proportions with small expected number of positive counts",
    Survey Methodology 24, 1998 (effective number).
    """
    share = np.asarray(hits, dtype=np.float64)
    codes = trajectory_codes(trajectories, share.size)
    p, n = float(share.mean()) if share.size else np.nan, share.size
    if n < MIN_SHARE:
        return Interval.unknown(p, f"n {n}, a share needs {MIN_SHARE}")
    rho = rho_cut = autocorrelation(share, codes)
    if errors is not None:
        cut = np.where(np.isnan(errors), np.inf, errors)
        rho_cut = indicator_autocorrelation(_latent_autocorrelation(cut, codes))
    parts = spreads(share, codes, rho)
    counts = [p * (1 - p) / part.error**2 for part in parts if part.error > 0]
    effective = float(np.clip(min(n / variance_inflation(rho_cut, n), *counts, n), 1, n))
    t = max(part.critical(level) for part in parts)
    low, high = wilson_bounds(p, effective, t)
    return Interval(low, p, high, level, sample=Sample(n, effective, _count(codes)))


def wilson_bounds(p: float, effective: float, t: float) -> tuple[float, float]:
    """Bounds of a share `p` of so many independent rows, in [0, 1]; `t`: the critical value."""
    middle = (p + t * t / (2 * effective)) / (1 + t * t / effective)
    half = t / (1 + t * t / effective) * np.sqrt(p * (1 - p) / effective
                                                 + (t / (2 * effective)) ** 2)  # fmt: skip
    return float(min(max(middle - half, 0.0), p)), float(max(min(middle + half, 1.0), p))


def spearman(
    first: Floats, second: Floats, trajectories: Codes | None = None, *, level: float = LEVEL
) -> Interval:
    """Rank correlation of two series (n,); Pearson's has no interval that holds for skewed errors.

    Source: Bonett and Wright, "Sample size requirements for estimating Pearson, Kendall and
    Spearman correlations", Psychometrika 65, 2000.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    keep = ~(np.isnan(first) | np.isnan(second))
    kept = None if trajectories is None else np.asarray(trajectories)[keep]
    codes = trajectory_codes(kept, int(keep.sum()))
    first, second = first[keep], second[keep]
    n = first.size
    if n < 2:
        return Interval.unknown(np.nan, f"n {n}, a correlation needs {MIN_SHARE}")
    if any(values.min() == values.max() for values in (first, second)):
        return Interval.unknown(np.nan, "all values are equal")
    x, y = _standardised(midranks(first)), _standardised(midranks(second))
    r = float(np.mean(x * y))
    if n < MIN_SHARE:
        return Interval.unknown(r, f"n {n}, a correlation needs {MIN_SHARE}")
    held = float(np.clip(r, -0.999, 0.999))
    influence = (x * y - held * (x * x + y * y) / 2) / (1 - held * held)
    both = autocorrelation(normal_scores(first), codes) * autocorrelation(
        normal_scores(second), codes
    )
    parts = spreads(influence, codes, max(autocorrelation(influence, codes), both))
    effective = n / variance_inflation(both, n)
    normal = float(special.ndtri(0.5 + level / 2))
    half = max(
        normal * _FISHER * _fisher_error(effective),
        *(part.critical(level) * _fisher_error(part.error**-2) for part in parts if part.error),
    )
    centre = np.arctanh(held)
    low, high = float(np.tanh(centre - half)), float(np.tanh(centre + half))
    return Interval(min(low, r), r, max(high, r), level,
                    sample=Sample(n, min(effective, n), _count(codes)))  # fmt: skip


def _fisher_error(effective: float) -> float:
    """Standard error of Fisher's z of so many independent pairs."""
    return float(1 / np.sqrt(max(effective - 3, 1)))


def _known(values: Floats, trajectories: Codes | None) -> tuple[Floats, NDArray[np.intp]]:
    values = np.asarray(values, dtype=np.float64)
    keep = ~np.isnan(values)
    if trajectories is not None:
        trajectories = np.asarray(trajectories)
    kept = None if trajectories is None else trajectories[keep]
    return values[keep], trajectory_codes(kept, int(keep.sum()))


def _latent_autocorrelation(values: Floats, codes: NDArray[np.intp]) -> float:
    """Autocorrelation of the normal scores; of many values, from their halves above the median."""
    if values.size <= _MOST_RANKED:
        return autocorrelation(normal_scores(values), codes)
    above = (values > np.median(values)).astype(np.float64)
    return float(np.sin(np.pi / 2 * autocorrelation(above, codes)))


def _count(codes: NDArray[np.intp]) -> int:
    return int(codes[-1]) + 1


def _too_few(values: Floats, minimum: int, what: str) -> str:
    if values.size < minimum:
        return f"n {values.size}, {what} needs {minimum}"
    return "all values are equal" if values.min() == values.max() else ""


def _no_spread(values: Floats) -> str:
    """Why the standard deviation of `values` (n,) is 0 or not finite; "" where it is neither."""
    with np.errstate(over="ignore", invalid="ignore"):
        spread = float(values.std())
    if not np.isfinite(spread):
        return "a value is infinite or too large"
    return "" if spread else "all values are equal"


def _quantile(values: Floats, q: float) -> float:
    """The quantile `q` of `values` (n,), which may be infinite."""
    with np.errstate(invalid="ignore"):
        value = float(np.quantile(values, q))
    return float(np.quantile(values, q, method="higher")) if np.isnan(value) else value


def _sample(values: Floats, codes: NDArray[np.intp], parts: list[Spread]) -> Sample:
    error = max(part.error for part in parts)
    effective = float(np.clip((values.std() / error) ** 2, 1, values.size)) if error else 1.0
    return Sample(values.size, effective, _count(codes))


def skewness(values: Floats) -> float:
    """Skewness of a sample (n,), adjusted for its size; 0 below three values."""
    n, deviations = values.size, values - values.mean()
    squares = deviations * deviations
    variance = float(squares.mean())
    if n < 3 or variance == 0:
        return 0.0
    return float((squares * deviations).mean() / variance**1.5 * np.sqrt(n * (n - 1)) / (n - 2))


def skewed_bounds(value: float, spread: Spread, g: float, level: float) -> tuple[float, float]:
    """Bounds of an estimate whose studentised value has the skewness `g`, by Hall's cubic."""
    sign = -1.0 if g < 0 else 1.0
    g, t = float(np.clip(abs(g), 1e-6, _MAX_SKEWNESS)), spread.critical(level)

    def inverse(x: float) -> float:
        return float(3 / g * (np.cbrt(1 + g * (x - g / 6)) - 1))

    low, high = sign * value - spread.error * inverse(t), sign * value - spread.error * inverse(-t)
    return (low, high) if sign > 0 else (-high, -low)


def _standardised(values: Floats) -> Floats:
    return np.asarray((values - values.mean()) / values.std())
