"""What workers bring: each feed says when it is wanted, and reads it outside the screen's thread.

A new feed is a function here and a line in `FEEDS`. Of several requests the newest wins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rtui.plots.same import Same
from s2rtui.session import derive, heat
from s2rtui.session.state import State

Key = tuple[object, ...]
Told = Callable[[float], bool]
Fields = dict[str, Any]

REST_SECONDS = 0.15
MOST_GATHERED = 2000
"""A larger selection's heat is gathered over so many of its instances, evenly taken."""


@dataclass(frozen=True, slots=True)
class Feed:
    """`wants` gives what the result depends on, None for nothing; `read` fields of `Resources`.

    `empty` is shown while nothing is wanted. A feed that `rests` waits until keys are at rest.
    """

    name: str
    wants: Callable[[Store, State], Key | None]
    read: Callable[[Store, State, Told], Fields]
    empty: tuple[str, ...] = ()
    rests: bool = True


def _wants_rows(store: Store, state: State) -> Key:
    return (state.generation, state.runs)


def _read_rows(store: Store, state: State, told: Told) -> Fields:
    rows, baseline = derive.overview_rows(store)
    return {"rows": tuple(rows), "baseline": baseline}


def _wants_floor_plan(store: Store, state: State) -> Key | None:
    return (str(store.floor_plan_path()),) if store.floor_plan_path() else None


def _read_floor_plan(store: Store, state: State, told: Told) -> Fields:
    return {"floor_plan": derive.floor_plan(str(store.floor_plan_path()))}


def _wants_pictures(store: Store, state: State) -> Key | None:
    if state.cursor is None:
        return None
    return (state.generation, state.run, state.cursor, state.heat)


def _read_pictures(store: Store, state: State, told: Told) -> Fields:
    assert state.cursor is not None
    return {"pictures": derive.instance_input(store, state.run, state.cursor, state.heat)}


def _wants_grid(store: Store, state: State) -> Key | None:
    if state.heat is None or state.overlay == "off":
        return None
    about: object = None
    if state.overlay == "instance":
        about = state.cursor
    elif state.overlay == "selection":
        about = Same(state.selected)
    return (state.generation, state.run, state.heat, state.overlay, state.aggregate, about)


def _read_grid(store: Store, state: State, told: Told) -> Fields:
    assert state.heat is not None
    if state.overlay == "run":
        return {"grid": heat.run_grid(store, state.run, state.heat, state.aggregate)}
    if state.overlay == "instance":
        if state.cursor is None:
            return {"grid": None}
        return {"grid": heat.instance_grid(store, state.run, state.heat, state.cursor)}
    iids = evenly(np.flatnonzero(state.selected), MOST_GATHERED)
    if not iids.size:
        return {"grid": None}
    return {"grid": heat.gathered(store, state.run, state.heat, iids, state.aggregate, told)}


def _wants_seen(store: Store, state: State) -> Key | None:
    if not state.clip:
        return None
    return (state.generation, state.run, state.side, Same(state.selected))


def _read_seen(store: Store, state: State, told: Told) -> Fields:
    iids = evenly(np.flatnonzero(state.selected), MOST_GATHERED)
    return {"seen": heat.seen(store, state.run, state.side, iids, told)}


def evenly(iids: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """At most so many of the iids, in even steps."""
    if iids.size <= most:
        return iids
    return iids[np.linspace(0, iids.size - 1, most).round().astype(np.intp)]


FEEDS: tuple[Feed, ...] = (
    Feed("rows", _wants_rows, _read_rows, rests=False),
    Feed("floor plan", _wants_floor_plan, _read_floor_plan, ("floor_plan",), rests=False),
    Feed("pictures", _wants_pictures, _read_pictures, ("pictures",)),
    Feed("heat on the map", _wants_grid, _read_grid, ("grid",)),
    Feed("what was seen", _wants_seen, _read_seen, ("seen",)),
)
