"""An alarm over a history of measurements, with a budget of false alarms for a year.

Source: Roberts, "A comparison of some control chart procedures", Technometrics 8, 1966, and Pollak,
"Optimal detection of a change in distribution", Annals of Statistics 13, 1985 (Shiryaev-Roberts).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals.interval import LEVEL
from s2rstore.intervals.verdict import Outcome

YEAR = 365
"""Measurements that a budget of false alarms is for."""
BASELINE = 30
"""First measurements, which tell the level and its spread."""
_LARGEST_DEVIATION = 3.0
_SPREAD_QUANTILE = 0.1
"""The spread is taken at its upper bound: a baseline shows too little of it in one of ten cases."""
_SPEED, _FASTEST = 0.75, 1.5
"""Share of the wanted change that the statistic is tuned to, and its largest tuning in spreads."""
_MOST = 100.0
"""Statistic, in limits, beyond which it does not grow, so that an alarm ends soon after a mend."""
_LEAST_SPREAD = 0.05
"""Smallest spread that is believed, in wanted changes."""


@dataclass(frozen=True, slots=True)
class ChangeAlarm:
    """Whether the last of some measurements are above their baseline.

    outcome: INCONCLUSIVE until there are more than `BASELINE` measurements. since: number of the
    measurement from which the evidence grew, from 0; None without an alarm.
    """

    outcome: Outcome
    n: int
    baseline: float
    since: int | None = None


def change_alarm(
    values: NDArray[np.float64], change: float, *, budget: float = 1 - LEVEL
) -> ChangeAlarm:
    """Whether a measurement has risen since its first `BASELINE` values, by about `change` or more.

    `values` (n,) are independent measurements in order, `change` is in their unit and positive. In
    a year of `YEAR` measurements whose level does not change, the share `budget` of the histories
    has an alarm, or less (`python -m bench verdicts` measures it). The alarm lasts as long as the
    evidence stays above its limit. NaN values are left out; infinite ones are no part of the
    baseline and count as the largest deviation after it. Raises ValueError for a change that is not
    positive.
    """
    if not change > 0:
        raise ValueError(f"change {change:g}: must be positive")
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    limit = YEAR / budget
    finite = np.flatnonzero(np.isfinite(known))[:BASELINE]
    first = known[finite]
    level = float(first.mean()) if first.size else np.nan
    begin = int(finite[-1]) + 1 if finite.size == BASELINE else known.size
    if begin == known.size:
        return ChangeAlarm("INCONCLUSIVE", known.size, level)
    spread = float(first.std(ddof=1))
    raised = level + spread / np.sqrt(BASELINE)
    spread = max(spread * _spread_factor(), _LEAST_SPREAD * change)
    tuning = min(_SPEED * change / spread, _FASTEST)
    statistic, since = 0.0, begin
    for number, value in enumerate(known[begin:].tolist(), begin):
        deviation = float(np.clip((value - raised) / spread, -_LARGEST_DEVIATION,
                                  _LARGEST_DEVIATION))  # fmt: skip
        if statistic < 1:
            since = number
        grown = (1 + statistic) * np.exp(tuning * deviation - tuning**2 / 2)
        statistic = float(min(grown, _MOST * limit))
    if statistic > limit:
        return ChangeAlarm("FAIL", known.size, level, since)
    return ChangeAlarm("PASS", known.size, level)


def _spread_factor() -> float:
    """Upper bound of the spread over that of the baseline, for normal values."""
    from scipy import special

    freedom = BASELINE - 1
    return float(np.sqrt(freedom / special.chdtri(freedom, 1 - _SPREAD_QUANTILE)))
