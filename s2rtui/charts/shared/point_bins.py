"""Points in a plane: columns of coordinates, the nearest point, and the cells and dots they hit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rtui.analysis.binning import (
    Bins,
    Bools,
    Codes,
    SelectionIndices,
    count_selected,
    occupied_bins,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.drawing.scale import Floats, Interval, scale_fraction

PIECE = 1 << 15
LEVELS = 60
"""Steps of a value's scale; a multiple of ten, so that digits are exact."""


@cached_by_identity(16)
def point_cells(points: Floats, frame: MapFrame) -> Bins:
    """The cell of each point (N, 2) as bins, row by row; no bin outside the frame."""
    across, down = frame.width, frame.height // 2
    rows, columns = np.divmod(np.arange(8 * across * down), 2 * across)
    table = np.append(rows // 4 * across + columns // 2, across * down)
    codes = point_dots(points, frame).codes
    if across * down < 1 << 16:
        return Bins(table.astype(np.uint16)[codes], across * down)
    return Bins(table.astype(np.uint32)[codes], across * down)


@cached_by_identity(16)
def point_dots(points: Floats, frame: MapFrame) -> Bins:
    """The braille dot of each point (N, 2) as bins, row by row, 4 x 2 dots per cell.

    They are computed in pieces that fit into the processor's cache.
    """
    across, down = 2 * frame.width, frame.height // 2 * 4
    size, sign = across * down, 1 if frame.y_down else -1
    codes: Codes = np.empty(len(points), dtype=np.uint16 if size < 1 << 16 else np.uint32)
    for start in range(0, len(points), PIECE):
        piece = points[start : start + PIECE]
        column = np.floor((piece[:, 0] - frame.x0) * (2 / frame.pitch))
        row = np.floor((piece[:, 1] - frame.y0) * (2 * sign / frame.pitch))
        inside = (column >= 0) & (column < across) & (row >= 0) & (row < down)
        with np.errstate(invalid="ignore", over="ignore"):
            place = row * across + column
        codes[start : start + PIECE] = np.where(inside, place, size)
    return Bins(codes, size)


@cached_by_identity(6)
def selected_counts(
    points: Floats, selection: SelectionIndices, frame: MapFrame
) -> NDArray[np.intp]:
    """(rows, columns), read-only: number of selected points per cell."""
    counts, _ = count_selected(point_cells(points, frame), selection)
    counts = counts.reshape(frame.height // 2, frame.width)
    counts.setflags(write=False)
    return counts


@cached_by_identity(6)
def marked_cells(
    points: Floats, marked: Bools, selection: SelectionIndices, frame: MapFrame
) -> NDArray[np.bool_]:
    """(rows, columns), read-only: cells with a selected point of `marked` (N,)."""
    places, ids = point_cells(points, frame), selection.members
    codes = places.codes[ids[marked[ids]]]
    cells = np.zeros((frame.height // 2, frame.width), dtype=np.bool_)
    cells.flat[codes[codes < places.count]] = True
    cells.setflags(write=False)
    return cells


@cached_by_identity(4)
def unselected_dots(
    points: Floats, selection: SelectionIndices, frame: MapFrame
) -> NDArray[np.bool_]:
    """(4 rows, 2 columns), read-only: braille dots with an unselected valid point."""
    highlighted, total = count_selected(point_dots(points, frame), selection)
    others = (total > highlighted).reshape(frame.height // 2 * 4, frame.width * 2)
    others.setflags(write=False)
    return others


@dataclass(frozen=True, slots=True, eq=False)
class CellValues:
    """The selected points of each cell, (rows, columns), read-only.

    level: the largest value as a level 1 .. LEVELS; 0 for no known value, -1 for no selected point.
    count: number of selected points.
    """

    level: NDArray[np.intp]
    count: NDArray[np.intp]


@cached_by_identity(4)
def highest_levels(
    points: Floats, values: Floats, scale: Interval, selection: SelectionIndices, frame: MapFrame
) -> CellValues:
    """The largest value and the number of the selected points of each cell."""
    levels = _cell_levels(points, values, scale, frame)
    highlighted, _ = count_selected(levels.codes, selection)
    top = np.full(frame.height // 2 * frame.width, -1, dtype=np.intp)
    counts = np.zeros_like(top)
    if len(levels.cell):
        shown = np.where(highlighted > 0, levels.level, np.int8(-1))
        top[levels.cell] = np.maximum.reduceat(shown, levels.start)
        counts[levels.cell] = np.add.reduceat(highlighted, levels.start)
    for part in (top, counts):
        part.setflags(write=False)
    return CellValues(top.reshape(-1, frame.width), counts.reshape(-1, frame.width))


@dataclass(frozen=True, slots=True, eq=False)
class _CellLevels:
    """One bin per pair of cell and level that occurs.

    level: int8 level of each bin. cell: cells with points, `start`: the first bin of each.
    """

    codes: Bins
    level: NDArray[np.int8]
    cell: NDArray[np.intp]
    start: NDArray[np.intp]


@cached_by_identity(4)
def _cell_levels(points: Floats, values: Floats, scale: Interval, frame: MapFrame) -> _CellLevels:
    places = point_cells(points, frame)
    steps = np.uint32(LEVELS + 1)
    wide = places.codes.astype(np.uint32) * steps + _levels(values, scale)
    np.minimum(wide, places.count * steps, out=wide)
    codes, numbers = occupied_bins(Bins(wide, places.count * int(steps)))
    cell, start = np.unique(numbers // (LEVELS + 1), return_index=True)
    return _CellLevels(codes, (numbers % (LEVELS + 1)).astype(np.int8), cell, start)


def level_of(values: Floats, scale: Interval) -> NDArray[np.uint8]:
    """The level 1 .. `LEVELS` of each value (N,) on a scale; 0 for unknown values."""
    steps = np.minimum(scale_fraction(values, scale) * LEVELS, LEVELS - 1) + 1
    return np.nan_to_num(steps).astype(np.uint8)


_levels = cached_by_identity(8)(level_of)


def level_shares(levels: NDArray[np.intp]) -> NDArray[np.float64]:
    """Levels as fractions of the scale, 0 .. 1; NaN for unknown values."""
    return np.where(levels > 0, (levels - 1) / (LEVELS - 1), np.nan)


def true_positions(store: Store) -> NDArray[np.float64]:
    """(N, 2) true positions, metres."""
    return stacked_points(store.instances.x, store.instances.y)


def own_positions(store: Store, domain: str) -> NDArray[np.float64] | None:
    """(N, 2) true positions of a domain's images, metres; None where they are the instances'."""
    return _positions(store.poses(domain)) if domain in store.domains_with_own_poses else None


@cached_by_identity(4)
def _positions(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return poses[:, :2].copy()


@cached_by_identity(24)
def stacked_points(x: Floats, y: Floats) -> NDArray[np.float64]:
    """Stack two columns to (N, 2); the same columns give the same array, so caches keep working."""
    return np.stack([x, y], axis=1).astype(np.float64, copy=False)


def valid_cursor(cursor: int | None, valid: NDArray[np.bool_]) -> int | None:
    """The cursor if it is a valid iid, else None."""
    is_valid = cursor is not None and 0 <= cursor < len(valid) and valid[cursor]
    return cursor if is_valid else None


def known_point(points: NDArray[np.floating[Any]], iid: int | None) -> tuple[float, float] | None:
    """One of the points (N, 2), or None where it is unknown."""
    if iid is None or not np.isfinite(points[iid]).all():
        return None
    return float(points[iid, 0]), float(points[iid, 1])


def nearest_iid(
    points: NDArray[np.floating[Any]], base: NDArray[np.bool_], at: tuple[float, float]
) -> int | None:
    """The iid of the base population whose point (N, 2) is nearest to a place."""
    with np.errstate(invalid="ignore"):
        distance = np.square(points[:, 0] - at[0]) + np.square(points[:, 1] - at[1])
    distance = np.where(base & np.isfinite(distance), distance, np.inf)
    iid = int(np.argmin(distance)) if distance.size else 0
    return iid if distance.size and np.isfinite(distance[iid]) else None
