"""The cells and braille dots that instances hit, and what each cell shows of points and signs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Bools,
    Codes,
    SelectionIndices,
    count_selected,
    joint_bins,
    occupied_bins,
    selection_indices,
    sum_selected,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas
from s2rtui.drawing.plane_marks import Changes, Segments, Signs
from s2rtui.drawing.plot import Plot, Points
from s2rtui.drawing.scale import Floats, Range, Scale, scale_fraction

_PIECE = 1 << 15
"""Points that are placed at a time, which fit into the processor's cache."""
LEVELS = 60
"""Steps of a value's scale; a multiple of ten, so that digits are exact."""


class Grid(NamedTuple):
    """Scales of x and y, and the columns and rows of the cells of a plot."""

    x: Scale
    y: Scale
    width: int
    height: int

    def places(self, x: Floats, y: Floats) -> NDArray[np.float64]:
        """Columns and rows (n, 2) of points, with fractions."""
        return np.stack([self.x.fraction(x) * self.width, (1 - self.y.fraction(y)) * self.height],
                        axis=1)  # fmt: skip


def canvas_grid(canvas: Canvas, plot: Plot) -> Grid:
    """The cells of a plot that fills a canvas."""
    return Grid(plot.x, plot.y, canvas.width, canvas.height)


@dataclass(frozen=True, slots=True, eq=False)
class PointCells:
    """What the points of a plot show in h x w cells, row 0 at the top.

    level: (h, w) mean level of the selected per cell, 0 where it is unknown, -1 without a selected
    instance. dots: (4h, 2w) braille dots of the selected instances, and of the valid ones in cells
    without a selected one; count: (h, w) instances that each cell shows so. grey: the dots of cells
    without a selected one. trained: (h, w) cells with a selected trained instance. selected, total:
    number of instances in view.
    """

    level: NDArray[np.intp]
    dots: Bools
    count: NDArray[np.intp]
    grey: Bools
    trained: Bools
    selected: int
    total: int


def point_cells(points: Points, grid: Grid) -> PointCells:
    """The cells of a plot."""
    width, height = grid.width, grid.height
    place = points.x, points.y, grid
    selection = selection_indices(points.selected, points.valid)
    coloured = _levelled_cells(*place, points.levels, points.depth)
    highlighted, total = count_selected(coloured, selection)
    level = _mean_level(highlighted.reshape(height, width, points.depth + 1))
    of_selected, of_all = (
        counts.reshape(height, 4, width, 2)
        for counts in count_selected(dot_bins(*place), selection)
    )
    unselected = (level < 0)[:, None, :, None]
    shown = np.where(unselected, of_all, of_selected)
    shape = 4 * height, 2 * width
    trained = trained_cells(points, grid).reshape(height, width)
    return PointCells(
        level, (shown > 0).reshape(shape), shown.sum(axis=(1, 3)),
        ((of_all > 0) & unselected).reshape(shape), trained, int(highlighted.sum()),
        int(total.sum()),
    )  # fmt: skip


def trained_cells(mark: Points | Signs | Changes, grid: Grid) -> Bools:
    """(cells,) the cells with a selected instance that the model was trained on."""
    cells = np.zeros(grid.width * grid.height, dtype=np.bool_)
    if mark.trained is not None:
        members = selection_indices(mark.selected, mark.valid).members
        codes = cell_bins(mark.x, mark.y, grid).codes[members[mark.trained[members]]]
        cells[codes[codes < cells.size]] = True
    return cells


@cached_by_identity(16)
def dot_bins(x: Floats, y: Floats, grid: Grid) -> Bins:
    """The braille dot of each point (N,) in view, row by row from the top, 4 x 2 dots per cell."""
    across, up = grid.x, grid.y
    columns, rows = 2 * grid.width, 4 * grid.height
    size = columns * rows
    codes: Codes = np.empty(len(x), dtype=np.uint16 if size < 1 << 16 else np.uint32)
    for start in range(0, len(x), _PIECE):
        piece = slice(start, start + _PIECE)
        column = np.floor(across.fraction(x[piece]) * columns)
        row = rows - 1 - np.floor(up.fraction(y[piece]) * rows)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        with np.errstate(invalid="ignore", over="ignore"):
            place = row * columns + column
        codes[piece] = np.where(inside, place, size)
    return Bins(codes, size)


@cached_by_identity(16)
def cell_bins(x: Floats, y: Floats, grid: Grid) -> Bins:
    """The cell of each point (N,) in view, row by row from the top."""
    width, height = grid.width, grid.height
    rows, columns = np.divmod(np.arange(8 * width * height), 2 * width)
    table = np.append(rows // 4 * width + columns // 2, width * height)
    codes: Codes = table.astype(np.uint16 if width * height < 1 << 16 else np.uint32)
    return Bins(codes[dot_bins(x, y, grid).codes], width * height)


@cached_by_identity(16)
def _levelled_cells(x: Floats, y: Floats, grid: Grid, levels: Codes, depth: int) -> Bins:
    """Cell and level of each point together."""
    return joint_bins(cell_bins(x, y, grid), Bins(levels, depth + 1))


def _mean_level(table: NDArray[np.intp]) -> NDArray[np.intp]:
    """The mean level of counts per level (h, w, depth + 1), rounded to the nearest."""
    levels = np.arange(table.shape[2])
    known = table[..., 1:].sum(axis=2)
    mean = np.rint((table @ levels) / np.maximum(known, 1))
    return np.where(known > 0, mean, np.where(table[..., 0] > 0, 0, -1)).astype(np.intp)


Counts = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class SignCells:
    """The selected instances of each of k cells, as signs or as changes show them.

    columns, rows, counts: (k,). values: (k,) of signs the largest value as a fraction of the scale,
    NaN where it is unknown; of changes the mean. trained: (k,) whether a trained instance is among
    them.
    """

    columns: Counts
    rows: Counts
    counts: Counts
    values: NDArray[np.float64]
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


def change_cells(changes: Changes, grid: Grid) -> SignCells:
    """The cells with a selected instance whose change is known, row by row from the top."""
    selection = selection_indices(changes.selected, changes.valid)
    known = _known_cells(changes.x, changes.y, changes.values, grid)
    counts, _ = count_selected(known, selection)
    held = np.flatnonzero(counts)
    means = sum_selected(known, changes.values, selection)[held] / counts[held]
    rows, columns = np.divmod(held, grid.width)
    return SignCells(columns, rows, counts[held], means, trained_cells(changes, grid)[held])


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


def level_of(values: Floats, scale: Range) -> NDArray[np.uint8]:
    """The level 1 .. `LEVELS` of each value (N,) on a scale; 0 for unknown values."""
    steps = np.minimum(scale_fraction(values, scale) * LEVELS, LEVELS - 1) + 1
    return np.nan_to_num(steps).astype(np.uint8)


_levels = cached_by_identity(8)(level_of)


def level_shares(levels: NDArray[np.integer]) -> NDArray[np.float64]:
    """Levels as fractions of the scale, 0 .. 1; NaN for unknown values."""
    return np.where(levels > 0, (levels.astype(np.intp) - 1) / (LEVELS - 1), np.nan)


@cached_by_identity(8)
def _highest_levels(
    x: Floats, y: Floats, values: Floats, scale: Range, selection: SelectionIndices, grid: Grid
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
def _cell_levels(x: Floats, y: Floats, values: Floats, scale: Range, grid: Grid) -> _CellLevels:
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
