"""Turning ranges, the same numbers for both back ends."""

from __future__ import annotations

import math

TOLERANCE = 1e-9
TURN = 2 * math.pi


def wrapped(degrees: float) -> float:
    """Degrees to radians in [-pi, pi)."""
    return math.radians((degrees + 180.0) % 360.0 - 180.0)


def span(low: float, high: float) -> tuple[float, float] | None:
    """Ends in radians of a range in degrees, widened by rounding; None for the whole turn.

    The first end lies above the second where the range passes 180 degrees.
    """
    if high - low >= 360:
        return None
    return wrapped(low) - TOLERANCE, wrapped(high) + TOLERANCE
