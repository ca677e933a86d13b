"""The numbers of the rooms view: predicted and true instances per room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.rooms import NO_ROOM
from s2rtui.analysis import joint_histogram
from s2rtui.analysis.binning import Bins, Bools, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Mark
from s2rtui.charts.shared.points import valid_cursor

NAMES = ("sim", "truth", "real")
Counts = NDArray[np.intp]
Codes = NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class RoomsInput:
    """Rooms predicted in sim, true, predicted in real: (N,) indices of `room_names`, -1: none.

    selected, valid: (N,) bool; cursor: an iid. first: the first visible row where it was scrolled.
    """

    sim: Codes
    truth: Codes
    real: Codes
    room_names: tuple[str, ...]
    selected: Bools
    valid: Bools
    cursor: int | None = None
    mark: Mark | None = None
    first: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RoomsModel:
    """Counts per room.

    names: one per row, "no room" last if it occurs. highlighted, total: (3, rows) counts of the
    selected and of all valid instances, in the order of NAMES. peak: the largest count. cursor:
    the row of the cursor's instance in each column, or None.
    """

    names: tuple[str, ...]
    highlighted: Counts
    total: Counts
    peak: int
    cursor: tuple[int | None, int | None, int | None]


def rooms_model(data: RoomsInput) -> RoomsModel:
    """Count all three columns."""
    number = len(data.room_names)
    sides = (data.sim, data.truth, data.real)
    highlighted, total = _counts(sides, number, data.selected, data.valid)
    names = (*data.room_names, NO_ROOM)
    if not total[:, -1].any():
        names, highlighted, total = names[:-1], highlighted[:, :-1], total[:, :-1]
    cursor = valid_cursor(data.cursor, data.valid)
    at: list[int | None] = [None, None, None]
    if cursor is not None:
        rooms = [int(side[cursor]) for side in sides]
        at = [room if 0 <= room < number else number for room in rooms]
    peak = max(1, int(total.max(initial=0)))
    return RoomsModel(names, highlighted, total, peak, (at[0], at[1], at[2]))


@cached_by_identity(4)
def _counts(
    columns: tuple[Codes, ...], number: int, selected: Bools, valid: Bools
) -> tuple[Counts, Counts]:
    """Counts (3, number + 1) of selected and of all; the last column is "no room"."""
    selection = selection_indices(selected, valid)
    counted = joint_histogram.joint_counts([_bins(column, number) for column in columns], selection)
    highlighted, total = (np.stack(part) for part in zip(*counted, strict=True))
    return highlighted, total


@cached_by_identity(32)
def _bins(rooms: Codes, number: int) -> Bins:
    """The room of each instance as bins; the last one is "no room"."""
    inside = (rooms >= 0) & (rooms < number)
    kind = np.uint16 if number < (1 << 16) - 1 else np.uint32
    return Bins(np.where(inside, rooms, number).astype(kind), number + 1)
