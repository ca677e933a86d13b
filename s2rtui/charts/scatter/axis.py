"""The scale that both axes of the scatter view share, and the part of the plane that is shown.

Errors are metres, on linear or logarithmic axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.drawing.scale import Floats, tick_values

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
        """About `count` tick values: round numbers, or 1, 2 and 5 times 10^n on a log axis.

        A log axis that holds fewer than two of these has round numbers, too.
        """
        round_numbers = tick_values(self.low, self.high, count)
        if not self.log:
            return [value for value in round_numbers if value >= 0]
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        for factors in (_FACTORS, (1,)):
            values = [
                factor * 10.0**power for power in range(first, last + 1) for factor in factors
            ]
            shown = [value for value in values if self.low <= value <= self.high]
            if len(shown) <= count:
                break
        return shown if len(shown) > 1 else round_numbers


WHOLE = Bounds(0.0, 0.0, 1.0, 1.0)
"""All of the plane, as fractions of its axes."""


@dataclass(frozen=True, slots=True)
class ErrorPlane:
    """The plane of sim and real errors, both on `axis`; `shown` is the part in view.

    `shown` is a rectangle in fractions of the axes, x along the sim errors and y along the real
    ones. It may reach beyond them.
    """

    axis: ErrorAxis
    shown: Bounds = WHOLE

    @property
    def across(self) -> ErrorAxis:
        """The axis of sim errors from the left to the right end of the part in view."""
        return self._part(self.shown.x0, self.shown.x1)

    @property
    def up(self) -> ErrorAxis:
        """The axis of real errors from the lower to the upper end of the part in view."""
        return self._part(self.shown.y0, self.shown.y1)

    def _part(self, first: float, last: float) -> ErrorAxis:
        if (first, last) == (0.0, 1.0):
            return self.axis
        return ErrorAxis(self.axis.value(first), self.axis.value(last), self.axis.log)

    def drawn_across(self, errors: ArrayLike) -> NDArray[np.float64]:
        """The places of sim errors, 0 .. 1 in the part in view."""
        return (self.axis.drawn(errors) - self.shown.x0) / self.shown.width

    def drawn_up(self, errors: ArrayLike) -> NDArray[np.float64]:
        """The places of real errors, 0 .. 1 in the part in view."""
        return (self.axis.drawn(errors) - self.shown.y0) / self.shown.height


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
