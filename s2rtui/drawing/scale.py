"""The scale of an axis: places along it, ticks, labels that do not collide, short numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Range = tuple[float, float]
Floats = NDArray[np.floating]
Tick = tuple[float, str]
"""A value and its label."""


@dataclass(frozen=True, slots=True)
class Scale:
    """An axis from the value `low` to `high`, linear or logarithmic.

    names: what it shows with its unit, the longest first; an axis has the first one that fits.
    fixed: its ticks, where they are not round numbers. percent: whether labels of round numbers
    are percentages of values that are shares.
    """

    low: float
    high: float
    names: tuple[str, ...] = ()
    log: bool = False
    fixed: tuple[Tick, ...] | None = None
    percent: bool = False

    def fraction(self, values: ArrayLike) -> NDArray[np.float64]:
        """The places of values along the axis: 0 at `low`, 1 at `high`."""
        numbers = np.asarray(values, dtype=np.float64)
        if self.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(np.log(numbers / self.low) / math.log(self.high / self.low))
        return np.asarray((numbers - self.low) / (self.high - self.low))

    def value(self, fractions: ArrayLike) -> NDArray[np.float64]:
        """The values at places along the axis; the inverse of `fraction`."""
        places = np.asarray(fractions, dtype=np.float64)
        if self.log:
            return np.asarray(self.low * (self.high / self.low) ** places)
        return np.asarray(self.low + (self.high - self.low) * places)

    def ticks(self, most: int) -> tuple[Tick, ...]:
        """The fixed ticks, or round numbers that divide the axis into at most `most` intervals.

        Where fewer than two of these lie on the axis, it is divided into up to twice as many.
        Those of a logarithmic axis are 1, 2 and 5 times powers of 10, or powers of 10 alone where
        these are more than `most`; where fewer than two lie on the axis, round numbers.
        """
        if self.fixed is not None:
            return self.fixed
        low, high = sorted((self.low, self.high))
        if self.log:
            powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
            for factors in ((1, 2, 5), (1,)):
                numbers = [factor * 10.0**power for power in powers for factor in factors]
                shown = [value for value in numbers if low <= value <= high]
                if len(shown) <= most:
                    break
            if len(shown) > 1:
                return tuple((value, f"{value:g}") for value in shown)
        unit = 100.0 if self.percent else 1.0
        low, high = unit * low, unit * high
        if len(tick_values(low, high, most)) < 2:
            most *= 2
        width, values = tick_step(high - low, most), tick_values(low, high, most)
        return tuple((value / unit, tick_text(value, width)) for value in values)

    def name(self, room: float, extent: Callable[[str], float]) -> str:
        """The longest name that fits into `room`; empty where none does."""
        return next((name for name in self.names if extent(name) <= room), "")

    def labels(
        self, length: float, most: int, extent: Callable[[str], float], gap: float,
        beyond: float = 0.0,
    ) -> Iterator[tuple[float, float, str]]:  # fmt: skip
        """Yield (start, tick, label) of the ticks along an axis of some length.

        `extent` is the length of a text. Labels are centred at their ticks, moved to reach at most
        `beyond` the axis, and `gap` apart; one that would collide with the label before it is left
        out.
        """
        free = -math.inf
        for value, text in sorted(self.ticks(most), key=lambda tick: float(self.fraction(tick[0]))):
            tick, size = float(self.fraction(value)) * length, extent(text)
            start = min(max(tick - size / 2, -beyond), length + beyond - size)
            if 0 <= tick <= length and start >= free - 1e-9:
                yield start, tick, text
                free = start + size + gap


def finite_or_none(value: float | None) -> float | None:
    """The number, or None in place of NaN and infinities."""
    return float(value) if value is not None and math.isfinite(value) else None


def percentile_range(values: ArrayLike, low: float = 1.0, high: float = 99.0) -> Range:
    """The `low` and `high` percentiles of the finite values; (0, 1) without any."""
    array = np.asarray(values, dtype=np.float64).ravel()
    array = array[np.isfinite(array)]
    if not array.size:
        return (0.0, 1.0)
    bottom, top = np.percentile(array, [low, high])
    return non_empty(float(bottom), float(top))


def range_with_bounds(values: Sequence[float], bounds: Iterable[float], margin: float) -> Range:
    """The range of values, and of those bounds that are not far beyond it.

    They add at most `margin` times the range on either side.
    """
    low, high = min(values), max(values)
    reach = margin * (high - low)
    known = [end for end in bounds if math.isfinite(end)]
    ends = np.clip([low, high, *known], low - reach, high + reach)
    return non_empty(float(ends.min()), float(ends.max()))


def non_empty(low: float, high: float) -> Range:
    """The interval, widened a little where both ends coincide."""
    return (low, high) if high > low else (low, low + max(abs(low) * 1e-3, 1e-3))


def scale_fraction(values: ArrayLike, scale: Range) -> NDArray[np.float64]:
    """Convert numbers to fractions 0 .. 1 of a range, clipped; NaN stays NaN."""
    low, high = scale
    return np.clip((np.asarray(values, dtype=np.float64) - low) / (high - low), 0.0, 1.0)


def tick_step(span: float, count: int) -> float:
    """The smallest round step (1, 2 or 5 times 10^n) that gives at most `count` intervals."""
    raw = max(span, 1e-12) / max(1, count)
    power = 10.0 ** math.floor(math.log10(raw))
    for factor in (1, 2, 5, 10):
        if factor * power >= raw * (1 - 1e-9):
            return factor * power
    return 10 * power


def tick_values(low: float, high: float, count: int) -> list[float]:
    """Round numbers within [low, high] that divide it into at most `count` intervals."""
    if not (math.isfinite(low) and math.isfinite(high)) or high <= low:
        return []
    width = tick_step(high - low, count)
    first, last = math.ceil(low / width - 1e-9), math.floor(high / width + 1e-9)
    return [index * width for index in range(first, last + 1)]


def short_number(value: float | None, digits: int = 3) -> str:
    """A number with `digits` significant digits, without exponent where possible."""
    number = finite_or_none(value)
    if number is None:
        return "n/a"
    if number == 0:
        return "0"
    if not 1e-4 <= abs(number) < 1e6:
        return f"{number:.{digits - 1}g}"
    places = max(0, digits - 1 - math.floor(math.log10(abs(number))))
    text = f"{number:.{places}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def tick_text(value: float, width: float) -> str:
    """A tick's label with the decimals that steps of `width` need."""
    places = max(0, -math.floor(math.log10(width) + 1e-9)) if width < 1 else 0
    text = f"{value:.{places}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text
