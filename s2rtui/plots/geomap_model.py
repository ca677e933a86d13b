"""The geo-map as numbers: scales, colours and layers that terminal and paper share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.canvas.colour import Pixels, Theme, luma, mix, turbo
from s2rtui.plots.frame import MapFrame, sample
from s2rtui.plots.inputs import GeoMapInput, Interval
from s2rtui.plots.same import Same
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
    valid: NDArray[np.bool_] = np.asarray(view.valid, dtype=np.bool_)
    values = np.asarray(view.values, dtype=np.float64)
    scale = view.value_range or percentile_range(values[valid])
    lit = valid & np.asarray(view.selected, dtype=np.bool_)
    shares = fraction(values, scale)
    ids = np.flatnonzero(lit)
    steps = np.nan_to_num(shares[ids] * 65534 + 1).astype(np.uint16)
    order = ids[np.argsort(steps, kind="stable")]
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
    """(height, width, 3), read-only: the floor plan dimmed towards the background, heat on it.

    Kept for the last few frames: floor plan and heat are taken as never changed in place.
    """
    base = _floor(Same(view.floor_plan), view.bounds, view.y_down, frame, theme)
    layer, opacity = heat_layer(view, frame)
    if layer is None:
        return base
    return mix(base, turbo(layer), np.where(np.isfinite(layer), opacity, 0.0))


@lru_cache(8)
def _floor(plan: Same, bounds: Bounds, y_down: bool, frame: MapFrame, theme: Theme) -> Pixels:
    base = np.empty((frame.height, frame.width, 3), dtype=np.uint8)
    base[:] = theme.background
    if plan.array is not None and bounds.width > 0 and bounds.height > 0:
        floor = sample(plan.array, bounds, frame, top_is_y0=y_down)
        seen = np.asarray(np.isfinite(floor).all(axis=-1))
        floor = np.nan_to_num(floor)
        grey = np.repeat((luma(floor) * 255)[..., None], 3, axis=-1)
        share = 0.46 if theme.dark else 0.55
        paled = mix(base, 0.45 * floor + 0.55 * grey, share)
        base = np.where(seen[..., None], paled, base).astype(np.uint8)
    base.setflags(write=False)
    return base


def heat_layer(
    view: GeoMapInput, frame: MapFrame
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64]]:
    """The heat as fractions (height, width), NaN for none, and its opacity."""
    scale = heat_scale(view)
    if scale is None or view.bounds.width <= 0 or view.bounds.height <= 0:
        return None, np.zeros(())
    shares = fraction(_heat(Same(view.heat), view.bounds, frame), scale)
    return shares, 0.12 + 0.74 * np.nan_to_num(shares) ** 0.7


@lru_cache(8)
def _heat(heat: Same, bounds: Bounds, frame: MapFrame) -> NDArray[np.float32]:
    return sample(np.asarray(heat.array), bounds, frame, top_is_y0=True)
