"""Rooms as numbers: how many predictions and truths lie in each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from s2rtui.plots import joint
from s2rtui.plots.bins import Bins, choose
from s2rtui.plots.inputs import RoomsInput
from s2rtui.plots.same import Same, kept

NAMES = ("sim", "truth", "real")
NO_ROOM = "no room"
Counts = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class RoomsModel:
    """names: a row each, the last one for no room where any instance is in none.

    lit, total: (3, rows) counts of the selected and of all valid, in the order of NAMES. peak:
    the largest count. cursor: the row of the cursor's instance in each column, or None.
    """

    names: tuple[str, ...]
    lit: Counts
    total: Counts
    peak: int
    cursor: tuple[int | None, int | None, int | None]


@lru_cache(1)
def rooms_model(view: RoomsInput) -> RoomsModel:
    """Counts of all three columns over one scale."""
    number = len(view.room_names)
    sides = (view.sim, view.truth, view.real)
    columns = [_bins(Same(side), number) for side in sides]
    counted = joint.counts(columns, choose(view.selected, view.valid))
    lit, total = (np.stack([part[which] for part in counted]) for which in (0, 1))
    names = (*view.room_names, NO_ROOM)
    if not total[:, -1].any():
        names, lit, total = names[:-1], lit[:, :-1], total[:, :-1]
    cursor = view.cursor
    at: list[int | None] = [None, None, None]
    if cursor is not None and 0 <= cursor < len(view.valid) and view.valid[cursor]:
        at = [int(column.codes[cursor]) for column in columns]
    peak = max(1, int(total.max(initial=0)))
    return RoomsModel(names, lit, total, peak, (at[0], at[1], at[2]))


@kept(32)
def _bins(rooms: Same, number: int) -> Bins:
    """The room of each instance; what is in none has the last bin."""
    codes = np.asarray(rooms.array)
    inside = (codes >= 0) & (codes < number)
    kind = np.uint16 if number < (1 << 16) - 1 else np.uint32
    return Bins(np.where(inside, codes, number).astype(kind), number + 1)
