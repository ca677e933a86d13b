"""The numbers of the map's marks: error glyphs and error lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bins, Bools, SelectionIndices, count_selected, sum_selected
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.charts.shared.base_map_model import MapInput, MapModel, selected_in_frame
from s2rtui.charts.shared.point_bins import point_cells
from s2rtui.drawing.scale import Floats

SINGLES = 200
"""Above this number of visible selected instances, glyphs stand for blocks of cells."""
SMALLEST, LARGEST = 20.0, 180.0
"""Degrees of an arc of the smallest error, and of one of full scale."""
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
        """Whether glyphs stand for blocks of cells."""
        return int(self.counts.sum()) > SINGLES


def error_glyphs(
    data: MapInput, model: MapModel, frame: MapFrame, footprint: tuple[int, int]
) -> ErrorGlyphs:
    """The error glyphs of the selected instances in a frame, each on `footprint` cells.

    Up to `SINGLES` instances have a glyph at their true position, near ones a common glyph at
    their mean; more are combined by blocks of footprint size.
    """
    arrays = _Arrays(data.truth, *_sides(data))
    return _glyphs(arrays, full_scale(data), model.selection, frame, footprint)


class _Side(NamedTuple):
    """True and predicted positions (N, 2) of one side's images."""

    truth: Floats
    predicted: Floats


class _Arrays(NamedTuple):
    """True positions (N, 2) of the instances, where glyphs are drawn, and of both sides."""

    truth: Floats
    sim: _Side
    real: _Side


def _sides(data: MapInput) -> tuple[_Side, _Side]:
    return (
        _Side(data.true_positions("sim"), data.sim),
        _Side(data.true_positions("real"), data.real),
    )


@cached_by_identity(4)
def _glyphs(
    arrays: _Arrays,
    full: float,
    selection: SelectionIndices,
    frame: MapFrame,
    footprint: tuple[int, int],
) -> ErrorGlyphs:
    ids = selected_in_frame(arrays.truth, selection, frame, SINGLES)
    if ids is None:
        return _blocks(arrays, full, selection, frame, footprint)
    return _clusters(arrays, full, ids, frame, footprint)


def full_scale(data: MapInput) -> float:
    """The error of an arc of full scale: the 99th percentile of the valid errors."""
    return _full_scale(*_sides(data), data.valid)


@cached_by_identity(8)
def _full_scale(sim: _Side, real: _Side, valid: Bools) -> float:
    inside = np.asarray(valid, dtype=np.bool_)
    sizes = [np.hypot(*_errors(*side))[inside] for side in (sim, real)]
    known = np.concatenate(sizes)
    known = known[np.isfinite(known)]
    largest = float(np.percentile(known, 99)) if known.size else 0.0
    return largest if largest > 0 else 1.0


@cached_by_identity(4)
def _errors(start: Floats, end: Floats) -> tuple[Vectors, Vectors]:
    """Errors (N,) along x and y from true to predicted positions, metres."""
    return end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]


def _clusters(
    arrays: _Arrays, full: float, ids: NDArray[np.intp], frame: MapFrame, footprint: tuple[int, int]
) -> ErrorGlyphs:
    """One glyph per instance, combined with earlier ones within a footprint."""
    places = frame.to_cells(np.asarray(arrays.truth, dtype=np.float64)[ids])
    group = np.full(len(ids), -1, dtype=np.intp)
    number = 0
    for index in range(len(ids)):
        if group[index] < 0:
            near = (np.abs(places - places[index]) < footprint).all(axis=1)
            group[near & (group < 0)] = number
            number += 1
    counts = np.bincount(group, minlength=number)

    def mean(vectors: Vectors) -> Vectors:
        known = np.isfinite(vectors).all(axis=1)
        sizes = np.bincount(group[known], minlength=number)
        axes = [np.bincount(group[known], part[known], minlength=number) for part in vectors.T]
        with np.errstate(invalid="ignore"):
            return np.stack(axes, axis=1) / np.where(sizes > 0, sizes, np.nan)[:, None]

    sim, real = (
        mean(np.stack([part[ids] for part in _errors(*side)], axis=1))
        for side in (arrays.sim, arrays.real)
    )
    return ErrorGlyphs(mean(places), counts, sim, real, full)


def _blocks(
    arrays: _Arrays,
    full: float,
    selection: SelectionIndices,
    frame: MapFrame,
    footprint: tuple[int, int],
) -> ErrorGlyphs:
    """One glyph in the middle of each block of cells with a selected instance."""
    wide, high = footprint
    across = -(-frame.width // wide)
    column = _block_codes(arrays, frame, footprint)
    counts, _ = count_selected(column, selection)
    held = np.flatnonzero(counts)
    middles = np.stack([held % across * wide + wide / 2, held // across * high + high / 2], axis=1)

    def mean(side: _Side) -> Vectors:
        parts = [sum_selected(column, part, selection)[held] for part in _errors(*side)]
        return np.stack(parts, axis=1) / counts[held, None]

    return ErrorGlyphs(middles, counts[held], mean(arrays.sim), mean(arrays.real), full)


@cached_by_identity(4)
def _block_codes(arrays: _Arrays, frame: MapFrame, footprint: tuple[int, int]) -> Bins:
    """The block of each instance with known errors, as bins."""
    wide, high = footprint
    across, down = -(-frame.width // wide), -(-(frame.height // 2) // high)
    rows, columns = np.divmod(np.arange(frame.height // 2 * frame.width), frame.width)
    table = np.append(rows // high * across + columns // wide, across * down)
    codes = table.astype(np.uint16)[point_cells(arrays.truth, frame).codes]
    for side in (arrays.sim, arrays.real):
        for part in _errors(*side):
            codes[~np.isfinite(part)] = across * down
    return Bins(codes, across * down)


def arc_degrees(vectors: Vectors, full: float) -> Floats:
    """The width of the arc of each error (k, 2) in degrees; NaN where unknown."""
    share = np.minimum(np.hypot(vectors[:, 0], vectors[:, 1]) / full, 1.0)
    return np.maximum(SMALLEST, LARGEST * share)


def arc_turns(vectors: Vectors, y_down: bool) -> Floats:
    """The direction of each error on the screen: radians clockwise from the right."""
    return np.arctan2(vectors[:, 1] * (1 if y_down else -1), vectors[:, 0])


LINES_UP_TO = 24
"""Up to this number of selected instances (visible or in all), error lines are drawn."""


def iids_with_error_lines(
    data: MapInput, model: MapModel, frame: MapFrame | None = None, limit: int = LINES_UP_TO
) -> NDArray[np.intp]:
    """Iids whose error lines are drawn: the selected ones, or those in the frame, up to `limit`.

    The cursor's instance is always included.
    """
    ids = np.empty(0, dtype=np.intp)
    if model.highlighted <= limit:
        ids = model.selection.members
    elif frame is not None:
        near = selected_in_frame(np.asarray(data.truth), model.selection, frame, limit)
        ids = ids if near is None else near
    return ids if model.cursor is None else np.unique(np.append(ids, model.cursor))
