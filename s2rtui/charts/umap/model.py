"""The numbers of the umap view: a frame for both sides, and the levels of its cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import Bounds
from s2rtui.analysis.binning import (
    Bins,
    Bools,
    Codes,
    SelectionIndices,
    bin_values,
    count_selected,
    joint_bins,
    selection_indices,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame, fit_frame
from s2rtui.canvas import Mark
from s2rtui.charts.shared.points import point_cells, point_dots, stacked_points, valid_cursor
from s2rtui.drawing.scale import Floats, Interval, percentile_range, scale_fraction
from s2rtui.session.counted_values import counted_values
from s2rtui.session.state import State

LEVELS = 20
"""Steps of the colour scale; level 0 stands for no value."""
_WEIGHTS = np.stack([np.arange(LEVELS + 1) > 0, np.arange(LEVELS + 1) - 0.5], axis=1)
_WEIGHTS[0] = 0
"""Contribution of each level to the number of known values and to their sum."""


@dataclass(frozen=True, slots=True, eq=False)
class UmapInput:
    """Embeddings in the plane, sim and real in the same coordinates.

    sim, real: (N, 2), NaN for none. values: (N,) that colour the points, NaN for none (default:
    the distance between an instance's two points); `value_range` fixes its scale (default: the 1st
    .. 99th percentile). selected, valid: (N,) bool; cursor: an iid. viewport: the rectangle to
    show, by default all points. trained: (N,) marks instances that the model was trained on, None
    where none is shown.
    """

    sim: Floats
    real: Floats
    values: Floats | None
    selected: Bools
    valid: Bools
    cursor: int | None = None
    mark: Mark | None = None
    value_label: str = "distance"
    value_unit: str = ""
    value_range: Interval | None = None
    viewport: Bounds | None = None
    trained: Bools | None = None


@dataclass(frozen=True, slots=True, eq=False)
class UmapLayer:
    """One side in a frame of h x w cells.

    level: (h, w) mean value of the selected per cell as a level 1 .. LEVELS, 0 without a value, -1
    without a selected instance. dots: (4h, 2w) braille dots of the selected instances, and of the
    valid ones in cells without a selected one; count: (h, w) instances that each cell shows so.
    grey: the dots of cells without a selected one. selected, total: number of instances in the
    frame.
    """

    level: NDArray[np.int8]
    dots: Bools
    count: NDArray[np.intp]
    grey: Bools
    selected: int
    total: int


@dataclass(frozen=True, slots=True, eq=False)
class UmapModel:
    """Both sides in one frame, on one scale; cursor: a valid iid or None."""

    frame: MapFrame
    value_range: Interval
    sim: UmapLayer
    real: UmapLayer
    cursor: int | None


def umap_model(data: UmapInput, frame: MapFrame) -> UmapModel:
    """Compute the levels of each cell of `frame` (an even number of pixels high)."""
    values = umap_values(data)
    scale = value_range(data)
    selection = selection_indices(data.selected, data.valid)
    sim, real = (
        _layer(points, values, scale, frame, selection) for points in (data.sim, data.real)
    )
    return UmapModel(frame, scale, sim, real, valid_cursor(data.cursor, data.valid))


def umap_frame(data: UmapInput, columns: int, rows: int) -> MapFrame:
    """The window of `columns` x `rows` cells that shows the viewport."""
    return fit_frame(data.viewport or umap_extent(data), columns, 2 * rows, y_down=False)


def umap_extent(data: UmapInput) -> Bounds:
    """The rectangle that holds every point of both sides."""
    return _extent(data.sim, data.real)


def umap_values(data: UmapInput) -> Floats:
    """The values (N,) that colour the points, by default the distance between sim and real."""
    return _distance(data.sim, data.real) if data.values is None else data.values


def value_range(data: UmapInput) -> Interval:
    """The scale of the values, from all known points: independent of the trajectories in view."""
    return data.value_range or _percentiles(umap_values(data))


def level_shares() -> NDArray[np.float64]:
    """(LEVELS,) fractions of the scale of levels 1 .. LEVELS: the middle of each."""
    return (np.arange(LEVELS) + 0.5) / LEVELS


@cached_by_identity(16)
def _extent(sim: Floats, real: Floats) -> Bounds:
    """The box of all points of both sides with a small margin; the unit square without any."""
    ends = []
    for side in (sim, real):
        x, y = side.T
        finite = np.isfinite(x) & np.isfinite(y)
        if not finite.all():
            x, y = x[finite], y[finite]
        if x.size:
            ends += [(x.min(), y.min()), (x.max(), y.max())]
    if not ends:
        return Bounds(0.0, 0.0, 1.0, 1.0)
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    margin = 0.02 * float(max(*(high - low), 1e-3))
    (x0, y0), (x1, y1) = low - margin, high + margin
    return Bounds(float(x0), float(y0), float(x1), float(y1))


@cached_by_identity(16)
def _distance(sim: Floats, real: Floats) -> NDArray[np.float64]:
    apart = np.asarray(sim, dtype=np.float64) - np.asarray(real, dtype=np.float64)
    return np.hypot(apart[:, 0], apart[:, 1])


_percentiles = cached_by_identity(16)(percentile_range)


@cached_by_identity(16)
def _levels(values: Floats, scale: Interval) -> Bins:
    """The level of each instance as bins, 0 for no value."""
    steps = np.floor(scale_fraction(values, scale) * LEVELS)
    return bin_values(np.nan_to_num(np.minimum(steps, LEVELS - 1) + 1, nan=0.0), LEVELS + 1)


@cached_by_identity(16)
def _cells(points: Floats, frame: MapFrame, levels: Codes) -> Bins:
    """Cell and level together."""
    places = point_cells(points, frame)
    return joint_bins(places, Bins(levels, LEVELS + 1))


def _layer(
    points: Floats, values: Floats, scale: Interval, frame: MapFrame, selection: SelectionIndices
) -> UmapLayer:
    rows, columns, depth = frame.height // 2, frame.width, LEVELS + 1
    coloured = _cells(points, frame, _levels(values, scale).codes)
    highlighted, total = count_selected(coloured, selection)
    table = highlighted.reshape(rows, columns, depth)
    level = _mean_level(table)
    of_selected, of_all = (
        counts.reshape(rows, 4, columns, 2)
        for counts in count_selected(point_dots(points, frame), selection)
    )
    unselected = (level < 0)[:, None, :, None]
    shown = np.where(unselected, of_all, of_selected)
    shape = 4 * rows, 2 * columns
    return UmapLayer(
        level,
        (shown > 0).reshape(shape),
        shown.sum(axis=(1, 3)),
        ((of_all > 0) & unselected).reshape(shape),
        int(highlighted.sum()),
        int(total.sum()),
    )


def _mean_level(table: NDArray[np.intp]) -> NDArray[np.int8]:
    """The mean level of counts per level (h, w, LEVELS + 1)."""
    known, total = (table @ _WEIGHTS).transpose(2, 0, 1)
    mean = np.floor(total / np.maximum(known, 1)) + 1
    empty = np.where(table[..., 0] > 0, 0, -1)
    return np.where(known > 0, mean, empty).astype(np.int8)


def umap_input(
    store: Store, state: State, mark: Mark | None = None, viewport: Bounds | None = None
) -> UmapInput:
    """The embeddings of the state's run in the plane."""
    columns = store.run_columns(state.run)
    sim, real = (
        counted_values(state.population, columns, stacked_points(side.u, side.v))
        for side in (columns.sim, columns.real)
    )
    return UmapInput(
        sim,
        real,
        None,
        state.selected,
        state.base,
        cursor=state.cursor,
        mark=mark,
        viewport=viewport,
        trained=state.marked,
    )
