"""The geo-map as numbers: what is lit, on which scales; shared by terminal and paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.binning import Chosen, choose, count
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.charts.shared.axis_scale import fraction, percentile_range
from s2rtui.charts.shared.inputs import Bools, Floats, GeoMapInput, Interval
from s2rtui.charts.shared.map_layers import heat_scale
from s2rtui.charts.shared.points import cells

LINES_UP_TO = 24
"""So many selected instances, all or in view, get their error lines drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class GeoMapModel:
    """lit: how many are selected and valid; others: valid but not selected. cursor: valid."""

    chosen: Chosen
    lit: int
    others: int
    cursor: int | None
    value_range: Interval
    heat_range: Interval | None


def geomap_model(view: GeoMapInput) -> GeoMapModel:
    """What is drawn, and the scales."""
    valid: Bools = np.asarray(view.valid, dtype=np.bool_)
    chosen = choose(np.asarray(view.selected, dtype=np.bool_), valid)
    lit, others = sizes(chosen)
    scale = view.value_range or value_range(view.values, valid)
    cursor = cursor_of(view.cursor, valid)
    return GeoMapModel(chosen, lit, others, cursor, scale, heat_scale(view.ground))


def sizes(chosen: Chosen) -> tuple[int, int]:
    """How many of the base are selected, and how many are not."""
    few, base = len(chosen.few), int(np.count_nonzero(chosen.base))
    return (base - few, few) if chosen.inverted else (few, base - few)


def cursor_of(cursor: int | None, valid: Bools) -> int | None:
    """The cursor where it is a valid iid."""
    if cursor is None or not 0 <= cursor < valid.size or not valid[cursor]:
        return None
    return cursor


def value_range(values: Floats, valid: Bools) -> Interval:
    """The scale of values (N,): the 1st .. 99th percentile of the valid."""
    return _value_range(ArrayKey(values), ArrayKey(valid))


@cached_by_identity(16)
def _value_range(values: ArrayKey, valid: ArrayKey) -> Interval:
    return percentile_range(np.asarray(values.array)[np.asarray(valid.array)])


def by_value(view: GeoMapInput, model: GeoMapModel) -> tuple[NDArray[np.intp], Floats]:
    """The selected iids, the largest value last (drawn on top), and their places on the scale."""
    ids = model.chosen.members
    shares = fraction(np.asarray(view.values)[ids], model.value_range)
    ordered = np.argsort(np.nan_to_num(shares, nan=-1.0), kind="stable")
    return ids[ordered], shares[ordered]


def lined(
    view: GeoMapInput, model: GeoMapModel, frame: MapFrame | None = None, limit: int = LINES_UP_TO
) -> NDArray[np.intp]:
    """Iids whose error lines are drawn: the selected, or those in the frame, up to a limit.

    The cursor's is always one of them.
    """
    ids = np.empty(0, dtype=np.intp)
    if model.lit <= limit:
        ids = model.chosen.members
    elif frame is not None:
        near = in_frame(np.asarray(view.truth), model.chosen, frame, limit)
        ids = ids if near is None else near
    return ids if model.cursor is None else np.unique(np.append(ids, model.cursor))


def in_frame(truth: Floats, chosen: Chosen, frame: MapFrame, limit: int) -> NDArray[np.intp] | None:
    """The selected iids that lie in the frame; None where they are more than `limit`."""
    places = cells(truth, frame)
    if int(count(places, chosen)[0].sum()) > limit:
        return None
    ids = chosen.members
    return ids[places.codes[ids] < places.count]


def default_view(bounds: Bounds, truth: Floats, valid: Bools) -> Bounds:
    """The bounds, or the box of the points where the bounds are empty."""
    if bounds.width > 0 and bounds.height > 0:
        return bounds
    points = np.asarray(truth, dtype=np.float64)[np.asarray(valid, dtype=np.bool_)]
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return Bounds(0.0, 0.0, 1.0, 1.0)
    (x0, y0), (x1, y1) = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    return Bounds(float(x0), float(y0), float(x1), float(y1))
