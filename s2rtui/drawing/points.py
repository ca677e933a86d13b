"""The cells and braille dots that the points of a plot hit, and what each cell shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Bools,
    Codes,
    count_selected,
    joint_bins,
    selection_indices,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas
from s2rtui.drawing.plane_marks import Changes, Signs
from s2rtui.drawing.plot import Plot, Points
from s2rtui.drawing.scale import Floats, Scale

_PIECE = 1 << 15
"""Points that are placed at a time, which fit into the processor's cache."""


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
