"""The scale that both axes of the scatter view share: errors in metres, linear or logarithmic."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.charts.shared.axis_scale import Floats, tick_values

LOG_RATIO = 20.0
"""Axes are logarithmic where the largest error is more than this many times a side's median."""
LOG_RULE = f"the largest error is over {LOG_RATIO:g} times the median of a side"
_MARGIN = 1.03
"""Upper end of the axes over the largest error."""
_FACTORS = (1, 2, 5)


@dataclass(frozen=True, slots=True)
class ErrorAxis:
    """An axis from `low` to `high` metres; `log` where it is logarithmic.

    The lower end of a linear axis is 0. Errors below `low` are drawn at the lower end.
    """

    low: float
    high: float
    log: bool

    def fractions(self, errors: ArrayLike) -> NDArray[np.float64]:
        """Places of errors along the axis, 0 .. 1 from end to end, not clipped; NaN stays NaN."""
        values = np.asarray(errors, dtype=np.float64)
        if not self.log:
            return (values - self.low) / (self.high - self.low)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(values / self.low) / math.log(self.high / self.low)

    def drawn(self, errors: ArrayLike) -> NDArray[np.float64]:
        """The places at which errors are drawn, 0 .. 1, less than 1; NaN stays NaN."""
        return np.clip(self.fractions(errors), 0.0, np.nextafter(1.0, 0.0))

    def value(self, fraction: float) -> float:
        """The error at a place along the axis."""
        if not self.log:
            return self.low + fraction * (self.high - self.low)
        return float(self.low * (self.high / self.low) ** fraction)

    def ticks(self, count: int) -> list[float]:
        """About `count` tick values: round numbers, or 1, 2 and 5 times 10^n on a log axis."""
        if not self.log:
            return tick_values(self.low, self.high, count)
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        for factors in (_FACTORS, (1,)):
            values = [
                factor * 10.0**power for power in range(first, last + 1) for factor in factors
            ]
            shown = [value for value in values if self.low <= value <= self.high]
            if len(shown) <= count:
                break
        return shown


@cached_by_identity(8)
def error_axis(sim: Floats, real: Floats) -> ErrorAxis:
    """The axis that holds every known error of both sides (N,).

    Linear from 0, or logarithmic by `LOG_RATIO`; then its lower end is the 1st percentile of the
    errors above 0, rounded down to 1, 2 or 5 times 10^n.
    """
    sides = [errors[np.isfinite(errors)] for errors in (sim, real)]
    above = np.concatenate([errors[errors > 0] for errors in sides])
    if not above.size:
        return ErrorAxis(0.0, 1.0, log=False)
    high = float(above.max()) * _MARGIN
    if above.max() <= LOG_RATIO * min(np.median(errors) for errors in sides if errors.size):
        return ErrorAxis(0.0, high, log=False)
    return ErrorAxis(_rounded_down(float(np.percentile(above, 1))), high, log=True)


def _rounded_down(value: float) -> float:
    """The largest 1, 2 or 5 times 10^n that is not above `value` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(factor * power for factor in _FACTORS if factor * power <= value * (1 + 1e-9))
