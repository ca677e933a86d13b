"""Error glyphs of a map as numbers: a point, and the mean error vector of both sides there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bins, SelectionIndices, count_selected, sum_selected
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.charts.shared.axis_scale import Floats
from s2rtui.charts.shared.map_model import MapInput, MapModel, selected_in_frame
from s2rtui.charts.shared.points import point_cells

SINGLES = 200
"""More selected instances in view than these are shown by blocks of cells."""
SMALLEST, LARGEST = 20.0, 180.0
"""Degrees of an arc: of the smallest error, and of one of full scale."""
Vectors = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorGlyphs:
    """k glyphs. centres: (k, 2) cells; counts: (k,) instances that each is the mean of.

    sim, real: (k, 2) mean of prediction - truth in metres, NaN where unknown. full: the error
    of full scale in metres, the 99th percentile of the valid.
    """

    centres: Vectors
    counts: NDArray[np.intp]
    sim: Vectors
    real: Vectors
    full: float

    @property
    def crowded(self) -> bool:
        """Whether blocks stand for their instances."""
        return int(self.counts.sum()) > SINGLES


def error_glyphs(
    data: MapInput, model: MapModel, frame: MapFrame, footprint: tuple[int, int]
) -> ErrorGlyphs:
    """The glyphs of what is selected in the frame, each with `footprint` cells of its own.

    Up to `SINGLES` instances stand at their truth, those too near to each other together at
    their mean; more of them are taken together by blocks of footprint size, at the middle.
    """
    arrays = _Arrays(ArrayKey(data.truth), ArrayKey(data.sim), ArrayKey(data.real))
    return _glyphs(arrays, full_scale(data), model.selection, frame, footprint)


class _Arrays(NamedTuple):
    truth: ArrayKey
    sim: ArrayKey
    real: ArrayKey


@cached_by_identity(4)
def _glyphs(
    arrays: _Arrays,
    full: float,
    selection: SelectionIndices,
    frame: MapFrame,
    footprint: tuple[int, int],
) -> ErrorGlyphs:
    ids = selected_in_frame(np.asarray(arrays.truth.array), selection, frame, SINGLES)
    if ids is None:
        return _blocks(arrays, full, selection, frame, footprint)
    return _clusters(arrays, full, ids, frame, footprint)


def full_scale(data: MapInput) -> float:
    """The error that a full arc stands for: the 99th percentile of both sides' valid ones."""
    return _full_scale(
        ArrayKey(data.truth), ArrayKey(data.sim), ArrayKey(data.real), ArrayKey(data.valid)
    )


@cached_by_identity(8)
def _full_scale(truth: ArrayKey, sim: ArrayKey, real: ArrayKey, valid: ArrayKey) -> float:
    inside = np.asarray(valid.array, dtype=np.bool_)
    sizes = [np.hypot(*_errors(truth, side))[inside] for side in (sim, real)]
    known = np.concatenate(sizes)
    known = known[np.isfinite(known)]
    largest = float(np.percentile(known, 99)) if known.size else 0.0
    return largest if largest > 0 else 1.0


@cached_by_identity(4)
def _errors(truth: ArrayKey, side: ArrayKey) -> tuple[Vectors, Vectors]:
    """Errors (N,) along x and y, metres."""
    start, end = np.asarray(truth.array), np.asarray(side.array)
    return end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]


def _clusters(
    arrays: _Arrays,
    full: float,
    ids: NDArray[np.intp],
    frame: MapFrame,
    footprint: tuple[int, int],
) -> ErrorGlyphs:
    """One glyph per instance; what lies within a footprint of an earlier one joins that one."""
    truth, *sides = (np.asarray(part.array, dtype=np.float64)[ids] for part in arrays)
    places = frame.to_cells(truth)
    group = np.full(len(ids), -1, dtype=np.intp)
    found = 0
    for index in range(len(ids)):
        if group[index] < 0:
            near = (np.abs(places - places[index]) < footprint).all(axis=1)
            group[near & (group < 0)] = found
            found += 1
    counts = np.bincount(group, minlength=found)

    def mean(vectors: Vectors) -> Vectors:
        known = np.isfinite(vectors).all(axis=1)
        sizes = np.bincount(group[known], minlength=found)
        axes = [np.bincount(group[known], part[known], minlength=found) for part in vectors.T]
        with np.errstate(invalid="ignore"):
            return np.stack(axes, axis=1) / np.where(sizes > 0, sizes, np.nan)[:, None]

    sim, real = (mean(side - truth) for side in sides)
    return ErrorGlyphs(mean(places), counts, sim, real, full)


def _blocks(
    arrays: _Arrays,
    full: float,
    selection: SelectionIndices,
    frame: MapFrame,
    footprint: tuple[int, int],
) -> ErrorGlyphs:
    """One glyph in the middle of each block of cells that holds a selected instance."""
    wide, high = footprint
    across = -(-frame.width // wide)
    column = _block_codes(arrays, frame, footprint)
    counts, _ = count_selected(column, selection)
    held = np.flatnonzero(counts)
    middles = np.stack([held % across * wide + wide / 2, held // across * high + high / 2], axis=1)

    def mean(side: ArrayKey) -> Vectors:
        parts = [
            sum_selected(column, part, selection)[held] for part in _errors(arrays.truth, side)
        ]
        return np.stack(parts, axis=1) / counts[held, None]

    return ErrorGlyphs(middles, counts[held], mean(arrays.sim), mean(arrays.real), full)


@cached_by_identity(4)
def _block_codes(arrays: _Arrays, frame: MapFrame, footprint: tuple[int, int]) -> Bins:
    """The block of each instance whose two errors are known."""
    wide, high = footprint
    across, down = -(-frame.width // wide), -(-(frame.height // 2) // high)
    rows, columns = np.divmod(np.arange(frame.height // 2 * frame.width), frame.width)
    table = np.append(rows // high * across + columns // wide, across * down)
    codes = table.astype(np.uint16)[point_cells(np.asarray(arrays.truth.array), frame).codes]
    for side in (arrays.sim, arrays.real):
        for part in _errors(arrays.truth, side):
            codes[~np.isfinite(part)] = across * down
    return Bins(codes, across * down)


def arc_degrees(vectors: Vectors, full: float) -> Floats:
    """How wide the arc of each error (k, 2) is; NaN where it is unknown."""
    share = np.minimum(np.hypot(vectors[:, 0], vectors[:, 1]) / full, 1.0)
    return np.maximum(SMALLEST, LARGEST * share)


def arc_turns(vectors: Vectors, y_down: bool) -> Floats:
    """The direction of each error as drawn: radians clockwise on the screen from the right."""
    return np.arctan2(vectors[:, 1] * (1 if y_down else -1), vectors[:, 0])


LINES_UP_TO = 24
"""So many selected instances, all or in view, get their error lines drawn."""


def iids_with_error_lines(
    data: MapInput, model: MapModel, frame: MapFrame | None = None, limit: int = LINES_UP_TO
) -> NDArray[np.intp]:
    """Iids whose error lines are drawn: the selected, or those in the frame, up to a limit.

    The cursor's is always one of them.
    """
    ids = np.empty(0, dtype=np.intp)
    if model.highlighted <= limit:
        ids = model.selection.members
    elif frame is not None:
        near = selected_in_frame(np.asarray(data.truth), model.selection, frame, limit)
        ids = ids if near is None else near
    return ids if model.cursor is None else np.unique(np.append(ids, model.cursor))
