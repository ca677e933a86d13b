"""What each cell of a plot shows of instances that are drawn as signs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Bools,
    SelectionIndices,
    count_selected,
    occupied_bins,
    selection_indices,
    sum_selected,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.drawing.plane_marks import Changes, Segments, Signs
from s2rtui.drawing.points import Grid, cell_bins, trained_cells
from s2rtui.drawing.scale import Floats, Interval, scale_fraction

LEVELS = 60
"""Steps of a value's scale; a multiple of ten, so that digits are exact."""
Counts = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class SignCells:
    """The selected instances of each of k cells.

    columns, rows, counts: (k,). shares: (k,) the largest value as a fraction of the scale, NaN
    where it is unknown. trained: (k,) whether a trained instance is among them.
    """

    columns: Counts
    rows: Counts
    counts: Counts
    shares: NDArray[np.float64]
    trained: Bools


def sign_cells(signs: Signs, grid: Grid) -> SignCells:
    """The cells with a selected instance, row by row from the top."""
    selection = selection_indices(signs.selected, signs.valid)
    if signs.values is None:
        counts, _ = count_selected(cell_bins(signs.x, signs.y, grid), selection)
        levels = np.zeros_like(counts)
    else:
        levels, counts = _highest_levels(
            signs.x, signs.y, signs.values, signs.scale, selection, grid
        )
    held = np.flatnonzero(counts)
    rows, columns = np.divmod(held, grid.width)
    trained = trained_cells(signs, grid)[held]
    return SignCells(columns, rows, counts[held], level_shares(levels[held]), trained)


@dataclass(frozen=True, slots=True, eq=False)
class ChangeCells:
    """The selected instances with a known change in each of k cells, and their mean (k,)."""

    columns: Counts
    rows: Counts
    counts: Counts
    means: NDArray[np.float64]
    trained: Bools


def change_cells(changes: Changes, grid: Grid) -> ChangeCells:
    """The cells with a selected instance whose change is known, row by row from the top."""
    selection = selection_indices(changes.selected, changes.valid)
    known = _known_cells(changes.x, changes.y, changes.values, grid)
    counts, _ = count_selected(known, selection)
    held = np.flatnonzero(counts)
    means = sum_selected(known, changes.values, selection)[held] / counts[held]
    rows, columns = np.divmod(held, grid.width)
    return ChangeCells(columns, rows, counts[held], means, trained_cells(changes, grid)[held])


def change_signs(means: Floats, margin: float) -> NDArray[np.intp]:
    """-1 where a change is below 0, 1 where it is above, 0 within the margin."""
    return np.sign(means).astype(np.intp) * (np.abs(means) > margin)


def selected_in_view(
    x: Floats, y: Floats, selection: SelectionIndices, grid: Grid, most: int
) -> NDArray[np.intp] | None:
    """The selected iids in view; None if there are more than `most`."""
    places = cell_bins(x, y, grid)
    if int(count_selected(places, selection)[0].sum()) > most:
        return None
    ids = selection.members
    return ids[places.codes[ids] < places.count]


def drawn_segments(segments: Segments, grid: Grid, most: int) -> NDArray[np.intp]:
    """The iids whose segments are drawn: the selected, or those in view, if at most `most` are.

    The cursor's instance is always among them.
    """
    selection = selection_indices(segments.selected, segments.valid)
    if selected_count(segments.selected, segments.valid) <= most:
        ids = selection.members
    else:
        near = selected_in_view(*segments.start, selection, grid, most)
        ids = np.empty(0, dtype=np.intp) if near is None else near
    return ids if segments.cursor is None else np.unique(np.append(ids, segments.cursor))


@cached_by_identity(16)
def selected_count(selected: Bools, valid: Bools) -> int:
    """The number of selected valid instances."""
    return int(np.count_nonzero(selected & valid))


def level_of(values: Floats, scale: Interval) -> NDArray[np.uint8]:
    """The level 1 .. `LEVELS` of each value (N,) on a scale; 0 for unknown values."""
    steps = np.minimum(scale_fraction(values, scale) * LEVELS, LEVELS - 1) + 1
    return np.nan_to_num(steps).astype(np.uint8)


_levels = cached_by_identity(8)(level_of)


def level_shares(levels: NDArray[np.integer]) -> NDArray[np.float64]:
    """Levels as fractions of the scale, 0 .. 1; NaN for unknown values."""
    return np.where(levels > 0, (levels.astype(np.intp) - 1) / (LEVELS - 1), np.nan)


@cached_by_identity(8)
def _highest_levels(
    x: Floats, y: Floats, values: Floats, scale: Interval, selection: SelectionIndices, grid: Grid
) -> tuple[Counts, Counts]:
    """(cells,) the highest level and the number of the selected instances of each cell."""
    levels = _cell_levels(x, y, values, scale, grid)
    highlighted, _ = count_selected(levels.codes, selection)
    top, counts = (np.zeros(grid.width * grid.height, dtype=np.intp) for _ in range(2))
    if len(levels.cell):
        shown = np.where(highlighted > 0, levels.level, np.int8(0))
        top[levels.cell] = np.maximum.reduceat(shown, levels.start)
        counts[levels.cell] = np.add.reduceat(highlighted, levels.start)
    return top, counts


@dataclass(frozen=True, slots=True, eq=False)
class _CellLevels:
    """One bin per pair of cell and level that occurs.

    level: int8 level of each bin. cell: cells with points, `start`: the first bin of each.
    """

    codes: Bins
    level: NDArray[np.int8]
    cell: Counts
    start: Counts


@cached_by_identity(4)
def _cell_levels(x: Floats, y: Floats, values: Floats, scale: Interval, grid: Grid) -> _CellLevels:
    places = cell_bins(x, y, grid)
    steps = np.uint32(LEVELS + 1)
    wide = places.codes.astype(np.uint32) * steps + _levels(values, scale)
    np.minimum(wide, places.count * steps, out=wide)
    codes, numbers = occupied_bins(Bins(wide, places.count * int(steps)))
    cell, start = np.unique(numbers // (LEVELS + 1), return_index=True)
    return _CellLevels(codes, (numbers % (LEVELS + 1)).astype(np.int8), cell, start)


@cached_by_identity(4)
def _known_cells(x: Floats, y: Floats, values: Floats, grid: Grid) -> Bins:
    column = cell_bins(x, y, grid)
    none = column.codes.dtype.type(column.count)
    return Bins(np.where(np.isfinite(values), column.codes, none), column.count)
