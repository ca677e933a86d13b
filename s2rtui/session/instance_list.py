"""The selection as a list: its order, and moving through it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.session.session import Session
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes

COLUMNS = (
    "real.error", "sim.error", "gap", "shift", "real.heading_error", "sim.heading_error",
    "real.outlier", "sim.outlier",
    "real.rank", "sim.rank", "real.loss", "sim.loss", "real.accuracy", "sim.accuracy",
    "iid", "x", "y", "heading", "curvature", "seq", "room", "trajectory",
)  # fmt: skip
"""What a list can be sorted by beside remarks, as the language names it."""
REMARK = "remark"
"""The user's tags and note: sorted by the alphabet, instances without them last."""
NAMES = ("room", "trajectory")
"""Those of them that hold names: sorted by the alphabet."""
COUNTS = ("iid", "seq", "real.rank", "sim.rank")
"""Those of whole numbers; below 0, or no rank, there is none."""
_OF_TRUTH = ("x", "y", "heading", "curvature", "seq")
_UPWARDS = ("iid", "real.rank", "sim.rank", *_OF_TRUTH, *NAMES, REMARK)
_FEW = 6
"""A larger part of all than one in so many is taken from the order of all, which is kept."""


def columns(notes: Notes) -> tuple[str, ...]:
    """What a list can be sorted by where a user has made some notes."""
    return (*COLUMNS, REMARK) if notes.remarks else COLUMNS


def order(store: Store, state: State, notes: Notes) -> NDArray[np.intp]:
    """The selected iids in the list's order; ties by iid, what has no value last."""
    if state.sort == REMARK:
        return _remarked_first(
            ArrayKey(notes.remark_ranks), ArrayKey(state.selected), state.descending
        )
    values = None if state.sort == "iid" else column(store, state, state.sort)
    return _order(ArrayKey(values), ArrayKey(state.selected), state.descending)


@cached_by_identity(2)
def _order(values: ArrayKey, selected: ArrayKey, descending: bool) -> NDArray[np.intp]:
    chosen = np.asarray(selected.array)
    members = np.flatnonzero(chosen)
    if values.array is None:
        return members[::-1] if descending else members
    if members.size * _FEW < chosen.size:
        return members[_sorted(np.asarray(values.array)[members], descending)]
    order = _whole_order(values, descending)
    return order[chosen[order]]


@cached_by_identity(2)
def _remarked_first(places: ArrayKey, selected: ArrayKey, descending: bool) -> NDArray[np.intp]:
    chosen, known = np.asarray(selected.array), np.asarray(places.array)
    known = known[known[:, 0] < chosen.size]
    known = known[chosen[known[:, 0]]]
    first = known[_sorted(known[:, 1], descending), 0]
    rest = chosen.copy()
    rest[first] = False
    return np.concatenate([first, np.flatnonzero(rest)])


@cached_by_identity(2)
def _whole_order(values: ArrayKey, descending: bool) -> NDArray[np.intp]:
    return _sorted(np.asarray(values.array), descending)


def _sorted(values: NDArray[Any], descending: bool) -> NDArray[np.intp]:
    return np.argsort(-values if descending else values, kind="stable")


def column(store: Store, state: State, name: str) -> NDArray[np.float64]:
    """(N,) of a column of the list, in the index's units; of names their place in the alphabet."""
    truth, run = store.instances, store.run_columns(state.run)
    if name == "iid":
        return np.arange(len(truth), dtype=np.float64)
    if name in NAMES:
        return _places(getattr(truth, name), getattr(truth, f"{name}_names"))
    side, dot, rest = name.partition(".")
    owner: object = run.side("sim" if side == "sim" else "real") if dot else run
    if name in _OF_TRUTH:
        owner = truth
    values = np.asarray(getattr(owner, rest if dot else name), dtype=np.float64)
    if name in COUNTS:
        return np.where(values < (rest == "rank"), np.nan, values)
    return values


def _places(codes: NDArray[np.integer[Any]], names: Sequence[str]) -> NDArray[np.float64]:
    """Where each name stands among all; NaN for none (code -1)."""
    places = np.full(len(names) + 1, np.nan)
    places[sorted(range(len(names)), key=lambda code: names[code])] = np.arange(len(names))
    return places[codes]


def next_column(session: Session) -> State:
    """Sort by the next column, the largest first, or what counts upwards from its beginning."""
    state = session.state
    known = columns(session.notes)
    at = known.index(state.sort) + 1 if state.sort in known else 0
    name = known[at % len(known)]
    told = f"sorted by {name}"
    return session.change(sort=name, descending=name not in _UPWARDS, message=told)


def reverse(session: Session) -> State:
    return session.change(descending=not session.state.descending)


def move(session: Session, steps: int) -> State:
    """The cursor to another row of the list."""
    rows = order(session.store, session.state, session.notes)
    if not rows.size:
        return session.tell("nothing is selected")
    found = np.flatnonzero(rows == session.state.cursor)
    at = int(found[0]) if found.size else -1
    return session.put_cursor(int(rows[min(max(at + steps, 0), rows.size - 1)]))
