"""Errors as arcs around instances: near ones in common, and how wide and where an arc is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import (
    Bins,
    Bools,
    SelectionIndices,
    count_selected,
    selection_indices,
    sum_selected,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.drawing.plane_marks import Arcs, Columns
from s2rtui.drawing.points import Grid, cell_bins, selected_in_view
from s2rtui.drawing.scale import Floats

SINGLES = 200
"""Above this number of visible selected instances, glyphs stand for blocks of cells."""
SMALLEST, LARGEST = 20.0, 180.0
"""Degrees of an arc of the smallest error, and of one of full scale."""
Vectors = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorGlyphs:
    """k glyphs. centres: (k, 2) columns and rows of cells; counts: (k,) instances of each.

    sim, real: (k, 2) mean errors along x and y, NaN where unknown. trained: (k,) whether a
    trained instance is among them.
    """

    centres: Vectors
    counts: NDArray[np.intp]
    sim: Vectors
    real: Vectors
    trained: Bools

    @property
    def is_crowded(self) -> bool:
        """Whether glyphs stand for blocks of cells."""
        return int(self.counts.sum()) > SINGLES


@cached_by_identity(4)
def error_glyphs(arcs: Arcs, grid: Grid, footprint: tuple[int, int]) -> ErrorGlyphs:
    """The glyphs of the selected instances in view, each on `footprint` cells (wide, high).

    Up to `SINGLES` instances have a glyph at their place, near ones a common glyph at their mean;
    more are combined by blocks of footprint size.
    """
    selection = selection_indices(arcs.selected, arcs.valid)
    ids = selected_in_view(arcs.x, arcs.y, selection, grid, SINGLES)
    if ids is None:
        return _blocks(arcs, selection, grid, footprint)
    places = grid.places(arcs.x[ids], arcs.y[ids])
    group = _clusters(places, footprint)
    number = int(group.max(initial=-1)) + 1

    def mean(vectors: Floats) -> Vectors:
        known = np.isfinite(vectors).all(axis=1)
        sizes = np.bincount(group[known], minlength=number)
        axes = [np.bincount(group[known], part[known], minlength=number) for part in vectors.T]
        with np.errstate(invalid="ignore"):
            return np.stack(axes, axis=1) / np.where(sizes > 0, sizes, np.nan)[:, None]

    held = np.zeros(number, dtype=np.bool_)
    if arcs.trained is not None:
        held[group[arcs.trained[ids]]] = True
    sides = arcs.sim, arcs.real
    errors = [mean(np.stack([part[ids] for part in side], axis=1)) for side in sides]
    sizes = np.bincount(group, minlength=number)
    return ErrorGlyphs(mean(places), sizes, errors[0], errors[1], held)


def _clusters(places: Vectors, footprint: tuple[int, int]) -> NDArray[np.intp]:
    """The group of each place (n, 2): one that lies within a footprint of an earlier one."""
    group = np.full(len(places), -1, dtype=np.intp)
    number = 0
    for index in range(len(places)):
        if group[index] < 0:
            near = (np.abs(places - places[index]) < footprint).all(axis=1)
            group[near & (group < 0)] = number
            number += 1
    return group


def _blocks(
    arcs: Arcs, selection: SelectionIndices, grid: Grid, footprint: tuple[int, int]
) -> ErrorGlyphs:
    """One glyph in the middle of each block of cells with a selected instance."""
    wide, high = footprint
    across = -(-grid.width // wide)
    column = _block_codes(arcs.x, arcs.y, arcs.sim, arcs.real, grid, footprint)
    counts, _ = count_selected(column, selection)
    held = np.flatnonzero(counts)
    middles = np.stack([held % across * wide + wide / 2, held // across * high + high / 2], axis=1)

    def mean(side: Columns) -> Vectors:
        parts = [sum_selected(column, part, selection)[held] for part in side]
        return np.stack(parts, axis=1) / counts[held, None]

    marked = np.zeros(len(held), dtype=np.bool_)
    if arcs.trained is not None:
        members = selection.members
        marked = np.isin(held, column.codes[members[arcs.trained[members]]])
    return ErrorGlyphs(middles, counts[held], mean(arcs.sim), mean(arcs.real), marked)


@cached_by_identity(4)
def _block_codes(
    x: Floats, y: Floats, sim: Columns, real: Columns, grid: Grid, footprint: tuple[int, int]
) -> Bins:
    """The block of each instance with known errors, as bins."""
    (wide, high), width, height = footprint, grid.width, grid.height
    count = -(-width // wide) * -(-height // high)
    rows, columns = np.divmod(np.arange(height * width), width)
    table = np.append(rows // high * -(-width // wide) + columns // wide, count)
    codes = table.astype(np.uint16)[cell_bins(x, y, grid).codes]
    for part in (*sim, *real):
        codes[~np.isfinite(part)] = count
    return Bins(codes, count)


def arc_degrees(vectors: Vectors, full: float) -> Floats:
    """The width of the arc of each error (k, 2) in degrees; NaN where unknown."""
    share = np.minimum(np.hypot(vectors[:, 0], vectors[:, 1]) / full, 1.0)
    return np.maximum(SMALLEST, LARGEST * share)


def arc_turns(vectors: Vectors, y_down: bool) -> Floats:
    """The direction of each error on the screen: radians clockwise from the right."""
    return np.arctan2(vectors[:, 1] * (1 if y_down else -1), vectors[:, 0])


Spans = tuple[Floats, Floats]
"""First and last angle (k,) of arcs in degrees of the plane; NaN where unknown."""


def arc_spans(vectors: Vectors, full: float) -> Spans:
    """The arcs of errors (k, 2)."""
    middle, half = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0])), arc_degrees(vectors, full)
    return middle - half / 2, middle + half / 2


def arc_overlap(first: Spans, second: Spans) -> Spans:
    """The overlap of arcs of at most 180 degrees; the end is not above the start without one."""
    turn = 360 * np.rint((first[0] + first[1] - second[0] - second[1]) / 720)
    return np.maximum(first[0], second[0] + turn), np.minimum(first[1], second[1] + turn)
