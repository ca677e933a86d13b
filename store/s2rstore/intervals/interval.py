"""Confidence intervals as values: an estimate with its bounds, or the reason why it has none."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

LEVEL = 0.95
LEVEL_TEXT = f"{100 * LEVEL:g} %"

MIN_MEAN = 100
"""Fewest values of an interval of a mean: among fewer, no failure may be seen that comes rarely."""
MIN_POPULATION_MEAN = 200
"""As `MIN_MEAN`, of an interval that is also about trajectories like these."""
MIN_DIFFERENCE = 49
"""Fewest values of an interval of a mean difference."""
MIN_MEDIAN = 25
FEWEST_TRAJECTORIES = 3
"""Trajectories from which on their differences are estimated: below, only these are described."""
MIN_SHARE = 9
"""Fewest values of an interval of a proportion or a rank correlation."""


class Bound(float):
    """A bound of an interval, in texts with a `<` or `>` where the interval goes beyond all values.

    JSON, CSV and arithmetic have the number alone.
    """

    __slots__ = ("mark",)
    mark: str

    def __new__(cls, value: float, mark: str = "") -> Bound:
        bound = super().__new__(cls, value)
        bound.mark = mark
        return bound

    def __format__(self, spec: str) -> str:
        return self.mark + super().__format__(spec)


@dataclass(frozen=True, slots=True)
class Sample:
    """What an estimate rests on.

    n: number of values. effective_n: number of independent values that would be as informative.
    trajectories: number of trajectories the values are from.
    """

    n: int
    effective_n: float
    trajectories: int

    @property
    def text(self) -> str:
        """`n 100, about 31 independent`."""
        dependent = round(self.effective_n) < self.n
        about = f", about {self.effective_n:.0f} independent" if dependent else ""
        return f"n {self.n}{about}"

    @property
    def scope(self) -> str:
        """`about these 2 trajectories alone`, or `also about trajectories like these 5`."""
        if self.trajectories == 1:
            return "about this trajectory alone"
        if self.trajectories < FEWEST_TRAJECTORIES:
            return f"about these {self.trajectories} trajectories alone"
        return f"also about trajectories like these {self.trajectories}"


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with the bounds of its confidence interval at `level`.

    low, high: NaN where no interval is known, for a `reason`; infinite where the data bound the
    estimate on one side only. ends: the smallest and the largest value, which are drawn and
    printed in place of infinite bounds.
    """

    low: float
    value: float
    high: float
    level: float = LEVEL
    reason: str = ""
    ends: tuple[float, float] | None = None
    sample: Sample | None = None

    @classmethod
    def unknown(cls, value: float = math.nan, reason: str = "") -> Interval:
        """An estimate without bounds."""
        return cls(math.nan, value, math.nan, reason=reason)

    @property
    def is_known(self) -> bool:
        """Whether the interval has bounds; one of them may be infinite."""
        return not (math.isnan(self.low) or math.isnan(self.high))

    @property
    def text(self) -> str:
        """What the estimate rests on, as in `Sample.text`; empty where it is not known."""
        return "" if self.sample is None else self.sample.text

    @property
    def no_bounds(self) -> str:
        """`no interval: n 7, a median needs 25` where there are no bounds; else empty."""
        if self.is_known:
            return ""
        return f"no interval: {self.reason}" if self.reason else "no interval"

    def at_level(self, level: float) -> Interval:
        """The interval at another level, if the estimate varies as a normal one does."""
        quantiles = (NormalDist().inv_cdf((1 + each) / 2) for each in (level, self.level))
        scale = next(quantiles) / next(quantiles)
        below, above = self.value - self.low, self.high - self.value
        return replace(
            self, low=self.value - scale * below, high=self.value + scale * above, level=level
        )

    @property
    def excludes_zero(self) -> bool:
        return self.is_positive or self.is_negative

    @property
    def is_positive(self) -> bool:
        """Whether the quantity is known to exceed zero."""
        return self.low > 0

    @property
    def is_negative(self) -> bool:
        """Whether the quantity is known to be below zero."""
        return self.high < 0

    @property
    def bounds(self) -> tuple[Bound, Bound]:
        """Both bounds as finite numbers, marked in texts where infinite: `<1.2`, `>9.3`."""
        first, last = self.ends or (self.value, self.value)
        low = Bound(first, "<") if math.isinf(self.low) else Bound(self.low)
        high = Bound(last, ">") if math.isinf(self.high) else Bound(self.high)
        return low, high

    def bounds_text(
        self, number: Callable[[float], str] = "{:.2f}".format, unit: str = "", to: str = " to "
    ) -> str:
        """`0.84 to >1.57 m`, or `no interval: n 7, a median needs 25`."""
        if not self.is_known:
            return self.no_bounds
        return f"{to.join(self.bound_texts(number))} {unit}".rstrip()

    def as_json(self) -> dict[str, Any]:
        """The interval as JSON data; unknown and infinite numbers are null. `from_json` reads it.

        An interval without bounds has a `reason`; where one bound alone is null, the quantity is
        bounded on one side only.
        """
        sample = self.sample
        return {
            "low": _finite(self.low), "value": _finite(self.value), "high": _finite(self.high),
            "level": round(self.level, 6), "reason": self.reason or None,
            "ends": None if self.ends is None else [_finite(end) for end in self.ends],
            "n": None if sample is None else sample.n,
            "effective_n": None if sample is None else round(sample.effective_n, 1),
            "trajectories": None if sample is None else sample.trajectories,
        }  # fmt: skip

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Interval:
        """Read `as_json`. Raises ArithmeticError, KeyError, TypeError or ValueError."""
        value, reason = _number(data["value"]), str(data["reason"] or "")
        low, high = _number(data["low"]), _number(data["high"])
        if not reason and not (math.isnan(low) and math.isnan(high)):
            low = -math.inf if math.isnan(low) else low
            high = math.inf if math.isnan(high) else high
        ends = data["ends"] and (_number(data["ends"][0]), _number(data["ends"][1]))
        sample = None
        if data["n"] is not None:
            sample = Sample(int(data["n"]), float(data["effective_n"]), int(data["trajectories"]))
        return cls(low, value, high, float(data["level"]), reason, ends or None, sample)

    def bound_texts(self, number: Callable[[float], str]) -> tuple[str, str]:
        """Both bounds by `number`, marked as in `bounds`."""
        low, high = self.bounds
        return low.mark + number(float(low)), high.mark + number(float(high))

    def scaled(self, factor: float, shift: float = 0.0) -> Interval:
        """The interval of (quantity + `shift`) * `factor`, which is positive."""
        ends = self.ends and ((self.ends[0] + shift) * factor, (self.ends[1] + shift) * factor)
        low, value, high = ((x + shift) * factor for x in (self.low, self.value, self.high))
        return replace(self, low=low, value=value, high=high, ends=ends)

    def at_least(self, least: float) -> Interval:
        """The interval of max(quantity, `least`)."""
        low, value, high = (
            x if math.isnan(x) else max(x, least) for x in (self.low, self.value, self.high)
        )
        return replace(self, low=low, value=value, high=high)

    def clipped(self, low: float, high: float) -> Interval:
        """The interval with its bounds inside the range that the quantity can have."""
        return replace(self, low=_clip(self.low, low, high), high=_clip(self.high, low, high))


def _finite(number: float) -> float | None:
    return round(float(number), 6) if math.isfinite(number) else None


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _clip(bound: float, low: float, high: float) -> float:
    return bound if math.isnan(bound) else min(max(bound, low), high)


def simultaneous_level(comparisons: int, level: float = LEVEL) -> float:
    """Level at which each of several intervals holds so that all hold at once with `level`.

    Bonferroni's correction: 1 - (1 - level) / comparisons.
    """
    return 1 - (1 - level) / max(1, comparisons)


def difference_of(first: Interval, second: Interval) -> Interval:
    """`first` minus `second`, two independent estimates, from their intervals of one level.

    The distances from the estimates to the bounds add in squares. Source: Zou and Donner,
    "Construction of confidence limits about effect measures", Statistics in Medicine 27, 2008.
    """
    value = first.value - second.value
    if not (first.is_known and second.is_known):
        return Interval.unknown(value, first.reason or second.reason)
    low = value - math.hypot(first.value - first.low, second.high - second.value)
    high = value + math.hypot(first.high - first.value, second.value - second.low)
    ends = None
    if math.isinf(low) or math.isinf(high):
        (a, b), (c, d) = (tuple(map(float, part.bounds)) for part in (first, second))
        ends = (value - math.hypot(first.value - a, d - second.value),
                value + math.hypot(b - first.value, second.value - c))  # fmt: skip
    return Interval(low, value, high, first.level, ends=ends)
