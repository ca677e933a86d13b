"""Confidence intervals as values: an estimate with its bounds, or the reason why it has none."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
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
        return self._bound(self.low), self._bound(self.high)

    def _bound(self, bound: float) -> Bound:
        first, last = self.ends or (self.value, self.value)
        if math.isinf(bound):
            return Bound(last, ">") if bound > 0 else Bound(first, "<")
        return Bound(bound)

    def bounds_text(
        self, number: Callable[[float], str] = "{:.2f}".format, unit: str = "", to: str = " to "
    ) -> str:
        """`0.84 to >1.57 m`, or `no interval: n 7, a median needs 25`."""
        if not self.is_known:
            return self.no_bounds
        return f"{to.join(self.bound_texts(number))} {unit}".rstrip()

    def with_bounds(self, number: Callable[[float], str] = "{:.2f}".format) -> str:
        """`1.20 (0.84 .. >1.57)`, `1.20 (no interval: n 7, a median needs 25)`, `-` if unknown."""
        if math.isnan(self.value):
            return f"- ({self.no_bounds})" if self.reason else "-"
        return f"{number(self.value)} ({self.bounds_text(number, to=' .. ')})"

    def as_columns(self, name: str) -> dict[str, float | str | None]:
        """The columns `name`, `name_low`, `name_high`, which are null where not finite.

        `name_reason` says why a bound is null. `from_columns` reads them.
        """
        numbers = zip(_COLUMNS, (self.value, self.low, self.high), strict=True)
        found = {f"{name}{end}": x if math.isfinite(x) else None for end, x in numbers}
        return {**found, f"{name}_reason": self._null_reason}

    @classmethod
    def from_columns(cls, row: Mapping[str, Any], name: str) -> Interval:
        """Read `as_columns`; absent columns are unknown."""
        value, low, high = (_number(row.get(f"{name}{end}")) for end in _COLUMNS)
        reason = str(row.get(f"{name}_reason") or "")
        return cls(*_opened(low, value, high, reason))

    @property
    def _null_reason(self) -> str | None:
        """Why a bound is null in JSON; None where none is."""
        if not self.is_known:
            return self.reason or None
        return _OPEN.get((_side(self.low), _side(self.high)))

    def as_json(self) -> dict[str, Any]:
        """The interval as JSON data; unknown and infinite numbers are null. `from_json` reads it.

        Where a bound is null, `reason` says why.
        """
        sample = self.sample
        return {
            **{name: finite(getattr(self, name), 9) for name in ("low", "value", "high")},
            "level": round(self.level, 6), "reason": self._null_reason,
            "ends": None if self.ends is None else [finite(end, 9) for end in self.ends],
            "n": None if sample is None else sample.n,
            "effective_n": None if sample is None else round(sample.effective_n, 1),
            "trajectories": None if sample is None else sample.trajectories,
        }  # fmt: skip

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Interval:
        """Read `as_json`. Raises ArithmeticError, KeyError, TypeError or ValueError."""
        low, value, high, level, reason = _opened(
            _number(data["low"]), _number(data["value"]), _number(data["high"]),
            str(data["reason"] or ""), float(data["level"]),
        )  # fmt: skip
        ends = data["ends"] and (_number(data["ends"][0]), _number(data["ends"][1]))
        sample = None
        if data["n"] is not None:
            sample = Sample(int(data["n"]), float(data["effective_n"]), int(data["trajectories"]))
        return cls(low, value, high, level, reason, ends or None, sample)

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


_COLUMNS = ("", "_low", "_high")
_OPEN = {
    (-1, 0): "the data give no lower bound",
    (0, 1): "the data give no upper bound",
    (-1, 1): "the data give no bound",
    (1, 1): "the estimate is infinite",
}
"""Reasons why a stored bound is null, by the signs of the infinite bounds (0: finite)."""


def _side(bound: float) -> int:
    return int(math.copysign(1, bound)) if math.isinf(bound) else 0


def _opened(
    low: float, value: float, high: float, reason: str, level: float = LEVEL
) -> tuple[float, float, float, float, str]:
    """Arguments of an `Interval` from what was stored: nulls that an open side explains."""
    for sides, text in _OPEN.items():
        if reason == text:
            low, high = (
                math.copysign(math.inf, side) if side else bound
                for side, bound in zip(sides, (low, high), strict=True)
            )
            value = math.inf if sides[1] and math.isnan(value) else value
            return low, value, high, level, ""
    return low, value, high, level, reason


def finite(number: float, digits: int = 6) -> float | None:
    """Round a number for JSON; None for NaN and infinity, which JSON does not have."""
    return round(float(number), digits) if math.isfinite(number) else None


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
