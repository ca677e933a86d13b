"""The selection as a list: its order, and moving through it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rtui.session.session import Session
from s2rtui.session.state import State

COLUMNS = (
    "real.error", "sim.error", "gap", "shift", "real.heading_error", "sim.heading_error",
    "real.outlier", "sim.outlier",
    "iid", "x", "y", "heading",
)  # fmt: skip
"""What a list can be sorted by, as the language names it."""


def order(store: Store, state: State) -> NDArray[np.intp]:
    """The selected iids in the list's order; ties by iid, NaN last."""
    members = np.flatnonzero(state.selected)
    values = column(store, state, state.sort)[members]
    keys = -values if state.descending else values
    return members[np.argsort(keys, kind="stable")]


def column(store: Store, state: State, name: str) -> NDArray[np.float64]:
    """(N,) of a column of the list, in the index's units."""
    truth, run = store.instances, store.run_columns(state.run)
    if name == "iid":
        return np.arange(len(truth), dtype=np.float64)
    side, dot, rest = name.partition(".")
    owner = run.side("sim" if side == "sim" else "real") if dot else run
    if name in ("x", "y", "heading"):
        return np.asarray(getattr(truth, name), dtype=np.float64)
    return np.asarray(getattr(owner, rest if dot else name), dtype=np.float64)


def next_column(session: Session) -> State:
    """Sort by the next column, the largest first."""
    state = session.state
    name = COLUMNS[(COLUMNS.index(state.sort) + 1) % len(COLUMNS)]
    made = replace(state, sort=name, descending=name not in ("iid", "x", "y", "heading"))
    return session.set(replace(made, message=f"sorted by {name}", is_error=False))


def reverse(session: Session) -> State:
    return session.set(replace(session.state, descending=not session.state.descending))


def move(session: Session, steps: int) -> State:
    """The cursor to another row of the list."""
    rows = order(session.store, session.state)
    if not rows.size:
        return session.tell("nothing is selected")
    found = np.flatnonzero(rows == session.state.cursor)
    at = int(found[0]) if found.size else -1
    return session.put_cursor(int(rows[min(max(at + steps, 0), rows.size - 1)]))
