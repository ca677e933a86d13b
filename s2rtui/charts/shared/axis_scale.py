"""Axis scales: ranges, fractions of a range, ticks, and numbers as short text."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Interval = tuple[float, float]


def finite_or_none(value: float | None) -> float | None:
    """The number, or None in place of NaN and infinities."""
    return float(value) if value is not None and math.isfinite(value) else None


def percentile_range(values: ArrayLike, low: float = 1.0, high: float = 99.0) -> Interval:
    """The `low` and `high` percentiles of the finite values; (0, 1) without any."""
    array = np.asarray(values, dtype=np.float64).ravel()
    array = array[np.isfinite(array)]
    if not array.size:
        return (0.0, 1.0)
    bottom, top = np.percentile(array, [low, high])
    return non_empty(float(bottom), float(top))


def non_empty(low: float, high: float) -> Interval:
    """The interval, widened a little where both ends coincide."""
    return (low, high) if high > low else (low, low + max(abs(low) * 1e-3, 1e-3))


def scale_fraction(values: ArrayLike, scale: Interval) -> NDArray[np.float64]:
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


Floats = NDArray[np.floating]
