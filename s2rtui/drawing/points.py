"""The cells and braille dots that the points of a plot hit, and what each cell shows."""

from __future__ import annotations

from dataclasses import dataclass

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
from s2rtui.drawing.plot import Points
from s2rtui.drawing.scale import Floats, Scale

_PIECE = 1 << 15
"""Points that are placed at a time, which fit into the processor's cache."""


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


def point_cells(points: Points, x: Scale, y: Scale, width: int, height: int) -> PointCells:
    """The cells of a plot of `width` x `height` cells with these scales."""
    place = points.x, points.y, x, y, width, height
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
    trained = np.zeros((height, width), dtype=np.bool_)
    if points.trained is not None:
        members = selection.members
        codes = cell_bins(*place).codes[members[points.trained[members]]]
        trained.flat[codes[codes < trained.size]] = True
    return PointCells(
        level, (shown > 0).reshape(shape), shown.sum(axis=(1, 3)),
        ((of_all > 0) & unselected).reshape(shape), trained, int(highlighted.sum()),
        int(total.sum()),
    )  # fmt: skip


@cached_by_identity(16)
def dot_bins(x: Floats, y: Floats, across: Scale, up: Scale, width: int, height: int) -> Bins:
    """The braille dot of each point (N,) in view, row by row from the top, 4 x 2 dots per cell."""
    columns, rows = 2 * width, 4 * height
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
def cell_bins(x: Floats, y: Floats, across: Scale, up: Scale, width: int, height: int) -> Bins:
    """The cell of each point (N,) in view, row by row from the top."""
    rows, columns = np.divmod(np.arange(8 * width * height), 2 * width)
    table = np.append(rows // 4 * width + columns // 2, width * height)
    codes = dot_bins(x, y, across, up, width, height).codes
    if width * height < 1 << 16:
        return Bins(table.astype(np.uint16)[codes], width * height)
    return Bins(table.astype(np.uint32)[codes], width * height)


@cached_by_identity(16)
def _levelled_cells(
    x: Floats, y: Floats, across: Scale, up: Scale, width: int, height: int, levels: Codes,
    depth: int,
) -> Bins:  # fmt: skip
    """Cell and level of each point together."""
    return joint_bins(cell_bins(x, y, across, up, width, height), Bins(levels, depth + 1))


def _mean_level(table: NDArray[np.intp]) -> NDArray[np.intp]:
    """The mean level of counts per level (h, w, depth + 1), rounded to the nearest."""
    levels = np.arange(table.shape[2])
    known = table[..., 1:].sum(axis=2)
    mean = np.rint((table @ levels) / np.maximum(known, 1))
    return np.where(known > 0, mean, np.where(table[..., 0] > 0, 0, -1)).astype(np.intp)
