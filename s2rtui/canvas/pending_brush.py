"""What a pending brush means on panels that are no planes: a range, an arc, some steps."""

from __future__ import annotations

import math

from s2rtui.canvas.brush import Mark


def pending(mark: Mark | None, panel: str) -> Mark | None:
    """The mark where it belongs to `panel` and holds a point."""
    return mark if mark is not None and mark.panel == panel and mark.points else None


def range_of(mark: Mark) -> tuple[float, float]:
    """The lower and the upper end of x."""
    low, high = sorted((mark.points[0][0], mark.points[-1][0]))
    return low, high


def steps_of(mark: Mark) -> tuple[int, int]:
    """The first and the last whole y, both included."""
    low, high = sorted(round(y) for _, y in (mark.points[0], mark.points[-1]))
    return low, high


def arc_of(mark: Mark) -> tuple[float, float]:
    """The middle and half the width in degrees, from the first end turning to the last.

    As the language's range of a heading; ends further apart than a turn mean all of it.
    """
    start, stop = mark.points[0][0], mark.points[-1][0]
    width = min(stop - start, 360.0) if stop >= start else (stop - start) % 360
    return wrapped(start + width / 2), width / 2


def wrapped(degrees: float) -> float:
    """-180 up to, but without, 180."""
    turned = math.fmod(degrees + 180, 360)
    turned = turned + 360 if turned < 0 else turned
    return turned - 180 if turned < 360 else -180.0
