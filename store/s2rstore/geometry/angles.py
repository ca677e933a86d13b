"""Angles: wrapping, differences, ranges of headings and the headings of other conventions."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

TURN = 2 * math.pi
ROUNDING = 1e-9
"""Radians that a heading may lie outside a range of headings and still belong to it."""

Degrees = TypeVar("Degrees", float, NDArray[np.float64])


def wrap(angle: ArrayLike) -> NDArray[np.float64]:
    """Bring radians into [-pi, pi)."""
    values = np.asarray(angle, dtype=np.float64)
    return np.asarray((values + np.pi) % (2 * np.pi) - np.pi, dtype=np.float64)


def from_habitat(r: ArrayLike) -> NDArray[np.float64]:
    """Map heading of Habitat's yaw r (radians), whose forward is (-sin r, -cos r) in (x, z)."""
    return wrap(-np.pi / 2 - np.asarray(r, dtype=np.float64))


def distance(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """The smaller angle between two headings, radians in [0, pi]."""
    return np.abs(wrap(np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)))


def wrap_degrees(angle: Degrees) -> Degrees:
    """Bring degrees into [-180, 180)."""
    return (angle + 180.0) % 360.0 - 180.0


def heading_range(low: float, high: float) -> tuple[float, float] | None:
    """Ends in radians of a range in degrees, widened by `ROUNDING`; None for a whole turn.

    The first end lies above the second where the range passes 180 degrees.
    """
    if high - low >= 360:
        return None
    first, last = (math.radians(wrap_degrees(end)) for end in (low, high))
    return first - ROUNDING, last + ROUNDING
