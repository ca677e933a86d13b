"""Which points a polygon holds, by the even-odd rule: one formula for both back ends.

A point is inside where an odd number of edges lies to its right. An edge runs from its end with the
smaller y (included) to the one with the larger y (not included) and lies to the right where
x < xa + (y - ya) / (yb - ya) * (xb - xa). So a point on a left edge or on the edge of smallest y
belongs to the polygon and one on a right edge or on the edge of largest y does not: polygons that
share edges share no point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_CORNERS = 64
_ROWS_PER_BAND = 16_384
_MOST_BANDS = 64

Corners = tuple[tuple[float, float], ...]
Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Edge:
    """From y = `low` at x = `x` up to y = `high`; `rise` = high - low > 0, `run` along x."""

    low: float
    high: float
    x: float
    rise: float
    run: float


def edges(corners: Corners) -> list[Edge]:
    """The edges of the closed polygon that some y crosses."""
    crossed = []
    for first, second in zip(corners, (*corners[1:], corners[0]), strict=True):
        (xa, ya), (xb, yb) = sorted((first, second), key=lambda corner: corner[1])
        if ya < yb:
            crossed.append(Edge(ya, yb, xa, yb - ya, xb - xa))
    return crossed


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """Points in bands of y, so that a band is compared with few edges.

    `rows` (k,) are the finite points, band after band, `x` and `y` theirs; band i holds
    [starts[i], starts[i + 1]) and spans `low[i]` .. `high[i]`.
    """

    rows: NDArray[np.intp]
    x: Values
    y: Values
    starts: NDArray[np.intp]
    low: Values
    high: Values

    @property
    def nbytes(self) -> int:
        return self.rows.nbytes + self.x.nbytes + self.y.nbytes


def bands(x: Values, y: Values) -> Bands:
    """The points (n,) in at most 64 bands; those that are not finite are left out."""
    finite = np.isfinite(x)
    finite &= np.isfinite(y)
    every = bool(finite.all())
    rows = np.arange(x.size) if every else np.flatnonzero(finite)
    count = max(1, min(_MOST_BANDS, rows.size // _ROWS_PER_BAND))
    if count > 1:
        band = _band(y if every else y[rows], count)
        places = np.argsort(band, kind="stable")
        rows = places if every else rows[places]
        starts = np.concatenate([[0], np.cumsum(np.bincount(band, minlength=count))])
    else:
        starts = np.array([0, rows.size])
    starts = np.unique(starts)  # no band is empty
    ys = y[rows]
    low, high = (
        (reduce.reduceat(ys, starts[:-1]) if rows.size else ys)
        for reduce in (np.minimum, np.maximum)
    )
    return Bands(rows, x[rows], ys, starts, low, high)


def _band(y: Values, count: int) -> NDArray[np.uint8]:
    """Which of `count` bands of equal height each value lies in, roughly."""
    bottom, top = float(y.min()), float(y.max())
    scale = count / max(top - bottom, 1e-300)
    with np.errstate(over="ignore", invalid="ignore"):
        place = (y - bottom) * min(scale, 1e300)
        return np.minimum(np.nan_to_num(place, copy=False), count - 1).astype(np.uint8)


def inside(points: Bands, corners: Corners, n: int) -> NDArray[np.bool_]:
    """The points of a polygon, shape (n,)."""
    chosen = np.zeros(n, dtype=np.bool_)
    lines = edges(corners)
    spans = zip(points.starts[:-1], points.starts[1:], points.low, points.high, strict=True)
    for start, stop, low, high in spans:
        near = [edge for edge in lines if edge.low <= high and edge.high > low]
        if near:
            x, y = points.x[start:stop], points.y[start:stop]
            odd = np.zeros(x.size, dtype=np.bool_)
            with np.errstate(over="ignore", invalid="ignore"):
                for edge in near:
                    odd ^= _right_of(x, y, edge, edge.low <= low and edge.high > high)
            chosen[points.rows[start:stop]] = odd
    return chosen


def _right_of(x: Values, y: Values, edge: Edge, spans_all: bool) -> NDArray[np.bool_]:
    """Whether the edge lies to the right of each point."""
    at = y - edge.low
    at /= edge.rise
    at *= edge.run
    at += edge.x
    is_left = x < at
    if not spans_all:
        is_left &= y >= edge.low
        is_left &= y < edge.high
    return np.asarray(is_left)
