"""Confidence intervals of any statistic, from its values without each row or each unit.

Source: Efron and Stein, "The jackknife estimate of variance", Annals of Statistics 9, 1981.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from s2rstore.intervals.dependence import Codes, Floats, Spread
from s2rstore.intervals.estimates import linear, skewed_bounds, skewness
from s2rstore.intervals.interval import LEVEL, MIN_MEDIAN, Interval, Sample

MIN_UNITS = 2
"""Fewest independent units of an interval."""
_MOST_SKEWED = 0.9
"""Largest product of skewness and quantile; at 1 the bound of the correction is unstable."""
Statistics = Callable[[Floats], Sequence[float]]
"""Values of some statistics, where row k counts `weights[k]` times."""


def of_units(
    value: float, left_out: Floats, *, unit: str = "units", level: float = LEVEL
) -> Interval:
    """A statistic from its values `left_out` (G,) without each of G independent units.

    `unit` names the units in the plural, such as `drives`. The interval is Student's with G - 1
    degrees of freedom, joined with its correction for skewness, which makes it wider by half at
    most: few units tell their skewness badly. Units that all give the same value have no bounds,
    unless it is 0.
    """
    known = np.asarray(left_out, dtype=np.float64)
    count = known.size
    if count < MIN_UNITS:
        return Interval.unknown(value, f"{unit}: {count}, an interval needs {MIN_UNITS}")
    if not np.isfinite(known).all():
        return Interval.unknown(value, f"a single one of {count} {unit} determines it")
    if value == 0 and not known.any():
        return Interval(0.0, 0.0, 0.0, level, sample=Sample(count, count, count))
    if known.min() == known.max():
        return Interval.unknown(value, f"all {count} {unit} give the same value")
    influence = (count - 1) * (known.mean() - known)
    spread = Spread(float(np.sqrt(np.square(influence).sum() / (count * (count - 1)))), count - 1)
    half = spread.half_width(level)
    most = _MOST_SKEWED / spread.critical(level)
    g = float(np.clip(skewness(influence) / np.sqrt(count), -most, most))
    low, high = skewed_bounds(value, spread, g, level)
    return Interval(min(low, value - half), value, max(high, value + half), level,
                    sample=Sample(count, count, count))  # fmt: skip


def of_rows(statistics: Statistics, trajectories: Codes) -> list[Interval]:
    """Statistics of rows in recording order, whose trajectories are given (n,).

    Neighbouring rows may depend on each other, as in `estimates.linear`.
    """
    n = len(trajectories)
    values = list(statistics(np.ones(n)))
    if n < MIN_MEDIAN:
        return [Interval.unknown(value, f"n {n}, this figure needs {MIN_MEDIAN}")
                for value in values]  # fmt: skip
    found = []
    for value, column in zip(values, without_each(statistics, n).T, strict=True):
        influence = (n - 1) * (value - column)
        if np.isfinite(influence).all():
            found.append(linear(value, influence, trajectories, minimum=MIN_MEDIAN))
        else:
            found.append(Interval.unknown(value, "a single row determines it"))
    return found


def without_each(statistics: Statistics, count: int) -> Floats:
    """Values (count, statistics) without each of the rows."""
    weights = np.ones(count)
    found = []
    for row in range(count):
        weights[row] = 0.0
        found.append(list(statistics(weights)))
        weights[row] = 1.0
    return np.array(found, dtype=np.float64)
