"""The numbers of the comparison: which run has smaller errors, by how much, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rstore.records import Bounds, Room, Side
from s2rtui.analysis.binning import (
    Bins,
    Bools,
    SelectionIndices,
    bin_values,
    count_selected,
    selection_indices,
    sum_selected,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import BrushShape, Pixels, diverging
from s2rtui.charts.compare.change import EQUAL, Codes, RoomChanges, room_changes, sentences
from s2rtui.charts.shared.base_map_background import MapBackground
from s2rtui.charts.shared.base_map_model import selection_sizes
from s2rtui.charts.shared.point_bins import point_cells, valid_cursor
from s2rtui.drawing.scale import Floats

Means = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class CompareInput:
    """Errors of two runs on one map.

    truth: (N, 2) metres. first, second: (N,) errors of the runs `names` on `side` in `unit`, NaN
    for none. Differences are second - first: below 0 the second run is better, within `equal` both
    are equal. scale: the difference of full colour (default: the 99th percentile of the valid
    ones). trajectory, room: (N,) codes, -1 for none, of rooms as indices of `room_list`; None
    without them, as in `room_changes`. trained: (N,) marks instances that the model of either run
    was trained on, None where none is shown. first_room: the first row of the table of rooms. Other
    fields as in `MapInput`.
    """

    truth: Floats
    first: Floats
    second: Floats
    selected: Bools
    valid: Bools
    bounds: Bounds
    names: tuple[str, str] = ("first", "second")
    side: Side = "real"
    unit: str = "m"
    equal: float = EQUAL
    scale: float | None = None
    cursor: int | None = None
    y_down: bool = True
    floor_plan: NDArray[np.uint8] | None = None
    clip: Floats | Bools | None = None
    rooms: tuple[Room, ...] = ()
    room_names: bool = True
    mark: BrushShape | None = None
    trajectory: Codes | None = None
    room: Codes | None = None
    room_list: tuple[str, ...] = ()
    trained: Bools | None = None
    first_room: int = 0

    @property
    def ground(self) -> MapBackground:
        rooms = self.rooms if self.room_names else ()
        return MapBackground(self.bounds, self.y_down, self.floor_plan, clip=self.clip, rooms=rooms)

    @property
    def changes(self) -> RoomChanges:
        """The change of the selected instances, in total and by room."""
        members = _members(self.selected, self.valid)
        return room_changes(
            self.first, self.second, members, self.trajectory, self.room, self.room_list, self.equal
        )

    @property
    def sentences(self) -> str:
        """The comparison in sentences."""
        return sentences(self.changes.whole, self.names, self.side, self.unit, self.equal)


@dataclass(frozen=True, slots=True)
class CompareSummary:
    """Numbers of selected instances by the change from the first run to the second.

    improved: the second error is smaller by more than the margin; worse: larger; equal: neither;
    unknown: an error is missing.
    """

    improved: int
    worse: int
    equal: int
    unknown: int


@dataclass(frozen=True, slots=True, eq=False)
class CompareModel:
    """The numbers that are drawn, as in `MapModel`. scale: the difference of full colour."""

    selection: SelectionIndices
    highlighted: int
    others: int
    cursor: int | None
    scale: float
    summary: CompareSummary


def compare_model(data: CompareInput) -> CompareModel:
    """Compute the summary and the scale."""
    valid: Bools = np.asarray(data.valid, dtype=np.bool_)
    selection = selection_indices(np.asarray(data.selected, dtype=np.bool_), valid)
    highlighted, others = selection_sizes(selection)
    summary = _summary(data.first, data.second, data.equal, selection, highlighted)
    scale = data.scale or _scale(data.first, data.second, valid, data.equal)
    return CompareModel(
        selection, highlighted, others, valid_cursor(data.cursor, valid), scale, summary
    )


@cached_by_identity(8)
def _summary(
    first: Floats, second: Floats, equal: float, selection: SelectionIndices, highlighted: int
) -> CompareSummary:
    column = _verdicts(first, second, equal)
    improved, same, worse = count_selected(column, selection)[0].tolist()
    return CompareSummary(improved, worse, same, highlighted - worse - same - improved)


@cached_by_identity(4)
def _members(selected: Bools, valid: Bools) -> Bools:
    return np.asarray(selected & valid)


@cached_by_identity(4)
def cell_means(
    truth: Floats, first: Floats, second: Floats, selection: SelectionIndices, frame: MapFrame
) -> tuple[NDArray[np.intp], NDArray[np.intp], Means, NDArray[np.intp]]:
    """Columns, rows, mean differences and numbers (k,) of the cells with a selected instance."""
    column = _known_cells(truth, first, second, frame)
    counts, _ = count_selected(column, selection)
    held = np.flatnonzero(counts)
    means = sum_selected(column, differences(first, second), selection)[held] / counts[held]
    return held % frame.width, held // frame.width, means, counts[held]


def change_signs(means: Means, equal: float) -> NDArray[np.intp]:
    """-1: the second run is better, 1: the first is, 0: within the margin."""
    return np.sign(means).astype(np.intp) * (np.abs(means) > equal)


@cached_by_identity(4)
def differences(first: Floats, second: Floats) -> Means:
    """second - first of every instance, (N,); NaN where one is unknown."""
    return np.asarray(second, dtype=np.float64) - first


@cached_by_identity(4)
def constant_errors(points: Floats, valid: Bools, trained: Bools) -> NDArray[np.float64]:
    """Errors (N,) of a constant prediction: the mean of the points (N, 2) that are new to a run.

    valid: (N,) instances that the run predicted; trained: (N,) those it was trained on. All of them
    are taken where none is new.
    """
    places = np.asarray(points, dtype=np.float64)
    new = valid & ~trained
    members = places[new if new.any() else valid]
    members = members[np.isfinite(members).all(axis=1)]
    if not members.size:
        return np.full(len(places), np.nan)
    return np.asarray(np.hypot(*(places - members.mean(axis=0)).T))


@cached_by_identity(4)
def _verdicts(first: Floats, second: Floats, equal: float) -> Bins:
    """Improved, equal and worse as bins 0, 1 and 2."""
    apart = differences(first, second)
    places = np.where(np.abs(apart) > equal, np.sign(apart), 0) + 1
    return bin_values(np.where(np.isfinite(apart), places, np.nan), 3)


@cached_by_identity(4)
def _known_cells(truth: Floats, first: Floats, second: Floats, frame: MapFrame) -> Bins:
    column = point_cells(truth, frame)
    known = np.isfinite(differences(first, second))
    none = column.codes.dtype.type(column.count)
    return Bins(np.where(known, column.codes, none), column.count)


@cached_by_identity(8)
def _scale(first: Floats, second: Floats, valid: Bools, equal: float) -> float:
    """The 99th percentile of the absolute differences, at least twice the margin."""
    apart = np.abs(differences(first, second)[valid])
    apart = apart[np.isfinite(apart)]
    largest = float(np.percentile(apart, 99)) if apart.size else 1.0
    return max(largest, 2 * equal, 1e-9)


def sorted_by_difference(data: CompareInput, model: CompareModel) -> tuple[NDArray[np.intp], Means]:
    """Selected iids with both errors, by increasing absolute difference, and the differences."""
    ids = model.selection.members
    apart = differences(data.first, data.second)[ids]
    ids, apart = ids[np.isfinite(apart)], apart[np.isfinite(apart)]
    ordered = np.argsort(np.abs(apart), kind="stable")
    return ids[ordered], apart[ordered]


def difference_colours(means: ArrayLike, scale: float) -> Pixels:
    """Colours of differences: blue below 0, orange above, stronger for larger ones."""
    share = np.asarray(means, dtype=np.float64) / scale
    return diverging(np.sign(share) * np.sqrt(np.abs(share)))
