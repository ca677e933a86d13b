"""The geo-map as numbers: scales, colours and layers that terminal and paper share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.canvas.colour import Pixels, Theme, luma, mix, turbo
from s2rtui.plots.frame import MapFrame, sample
from s2rtui.plots.inputs import GeoMapInput, Interval
from s2rtui.plots.scale import fraction, percentile_range

LINES_UP_TO = 24
"""A selection of at most so many instances gets its error lines drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class GeoMapModel:
    """Normalised arrays of a map.

    fraction: (N,) value on the scale, NaN for none. lit: (N,) selected and valid; grey: (N,)
    valid but not selected. order: iids of `lit`, the largest value last (drawn on top). lines:
    iids whose error lines are drawn. cursor: a valid iid or None.
    """

    fraction: NDArray[np.float64]
    lit: NDArray[np.bool_]
    grey: NDArray[np.bool_]
    order: NDArray[np.intp]
    lines: NDArray[np.intp]
    cursor: int | None
    value_range: Interval
    heat_range: Interval | None


def geomap_model(view: GeoMapInput) -> GeoMapModel:
    """What is drawn, on which scales; shapes are those of the input."""
    valid = np.asarray(view.valid, dtype=np.bool_)
    values = np.asarray(view.values, dtype=np.float64)
    scale = view.value_range or percentile_range(values[valid])
    lit = valid & np.asarray(view.selected, dtype=np.bool_)
    shares = fraction(values, scale)
    ids = np.flatnonzero(lit)
    order = ids[np.argsort(np.nan_to_num(shares[ids], nan=-1.0), kind="stable")]
    cursor = view.cursor
    if cursor is not None and not (0 <= cursor < valid.size and valid[cursor]):
        cursor = None
    lines = order if view.mode == "full" and len(order) <= LINES_UP_TO else order[:0]
    if cursor is not None and view.mode == "full":
        lines = np.unique(np.append(lines, cursor))
    heat = heat_scale(view)
    return GeoMapModel(shares, lit, valid & ~lit, order, lines, cursor, scale, heat)


def heat_scale(view: GeoMapInput) -> Interval | None:
    """The heat's range: the given one, or 0 (where nothing is negative) to the 99th percentile."""
    if view.heat is None or not np.isfinite(view.heat).any():
        return None
    if view.heat_range is not None:
        return view.heat_range
    low, high = percentile_range(view.heat)
    return (0.0, high) if low >= 0 and high > 0 else (low, high)


def default_view(view: GeoMapInput) -> Bounds:
    """The bounds, or the box of the points where the bounds are empty."""
    bounds = view.bounds
    if bounds.width > 0 and bounds.height > 0:
        return bounds
    points = np.asarray(view.truth, dtype=np.float64)[np.asarray(view.valid, dtype=np.bool_)]
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return Bounds(0.0, 0.0, 1.0, 1.0)
    (x0, y0), (x1, y1) = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    return Bounds(float(x0), float(y0), float(x1), float(y1))


def ground_layer(view: GeoMapInput, frame: MapFrame, theme: Theme) -> Pixels:
    """(height, width, 3): the floor plan dimmed towards the background, the heat laid on it."""
    base = np.empty((frame.height, frame.width, 3), dtype=np.uint8)
    base[:] = theme.background
    if view.floor_plan is not None and view.bounds.width > 0 and view.bounds.height > 0:
        floor = sample(view.floor_plan, view.bounds, frame, top_is_y0=view.y_down)
        seen = np.isfinite(floor).all(axis=-1)
        floor = np.nan_to_num(floor)
        grey = np.repeat((luma(floor) * 255)[..., None], 3, axis=-1)
        muted = 0.45 * floor + 0.55 * grey
        share = 0.34 if theme.dark else 0.5
        base = np.where(seen[..., None], mix(base, muted, share), base).astype(np.uint8)
    layer, share = heat_layer(view, frame)
    if layer is not None:
        base = mix(base, turbo(layer), np.where(np.isfinite(layer), share, 0.0))
    return base


def heat_layer(
    view: GeoMapInput, frame: MapFrame
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64]]:
    """The heat as fractions (height, width), NaN for none, and its opacity."""
    scale = heat_scale(view)
    if view.heat is None or scale is None or view.bounds.width <= 0 or view.bounds.height <= 0:
        return None, np.zeros(())
    seen = sample(view.heat, view.bounds, frame, top_is_y0=True)
    shares = fraction(seen, scale)
    return shares, 0.35 + 0.5 * np.nan_to_num(shares)
