"""The list of the selected instances: its order, and reducers that move through it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import fields
from s2rstore.reader import Store
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.session.context import SessionContext
from s2rtui.session.population_values import population_ranks
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes

COLUMNS = (
    "real.error", "sim.error", "gap", "shift", "real.heading_error", "sim.heading_error",
    "real.outlier", "sim.outlier",
    "real.rank", "sim.rank", "real.loss", "sim.loss", "real.accuracy", "sim.accuracy",
    "iid", "x", "y", "heading", "curvature", "seq", "room", "trajectory",
)  # fmt: skip
"""Columns to sort by, named as in the selection language."""
IMAGE_COLUMNS = ("iid", "trajectory", "seq")
"""The columns of a data set without poses."""
REMARK = "remark"
"""The user's tags and note: sorted alphabetically, instances without them last."""
NAMES = ("room", "trajectory")
"""Columns of names, sorted alphabetically."""
COUNTS = ("iid", "seq", "real.rank", "sim.rank")
"""Columns of whole numbers; a negative number, or rank 0, is a missing value."""
_TRUTH_COLUMNS = ("x", "y", "heading", "curvature", "seq")
TRUTH_COLUMNS = ("iid", *_TRUTH_COLUMNS, *NAMES)
"""The columns of a store without a computed run."""
_ASCENDING = ("iid", "real.rank", "sim.rank", *_TRUTH_COLUMNS, *NAMES, REMARK)
_SMALL_PART = 6
"""A selection above 1 / 6 of all instances is taken from the cached order of all."""


def columns(store: Store, notes: Notes) -> tuple[str, ...]:
    """The columns to sort by; remarks are one of them if the user has made any."""
    known = stored_columns(store)
    return (*known, REMARK) if notes.remarks else known


def stored_columns(store: Store) -> tuple[str, ...]:
    """The columns that a store has values for, without the columns of the user."""
    if not store.has_poses:
        return IMAGE_COLUMNS
    return TRUTH_COLUMNS if store.missing_run else COLUMNS


def order(store: Store, state: State, notes: Notes) -> NDArray[np.intp]:
    """The selected iids in the order of the list; ties by iid, missing values last."""
    if state.sort == REMARK:
        return _remarked_first(notes.remark_ranks, state.chosen, state.descending)
    values = None if state.sort == "iid" else column(store, state, state.sort)
    return _order(values, state.chosen, state.descending)


@cached_by_identity(2)
def _order(
    values: NDArray[Any] | None, chosen: NDArray[np.bool_], descending: bool
) -> NDArray[np.intp]:
    members = np.flatnonzero(chosen)
    if values is None:
        return members[::-1] if descending else members
    if members.size * _SMALL_PART < chosen.size:
        return members[_sorted(values[members], descending)]
    order = _whole_order(values, descending)
    return order[chosen[order]]


@cached_by_identity(2)
def _remarked_first(
    places: NDArray[Any], chosen: NDArray[np.bool_], descending: bool
) -> NDArray[np.intp]:
    known = places[places[:, 0] < chosen.size]
    known = known[chosen[known[:, 0]]]
    first = known[_sorted(known[:, 1], descending), 0]
    rest = chosen.copy()
    rest[first] = False
    return np.concatenate([first, np.flatnonzero(rest)])


@cached_by_identity(2)
def _whole_order(values: NDArray[Any], descending: bool) -> NDArray[np.intp]:
    return _sorted(values, descending)


def _sorted(values: NDArray[Any], descending: bool) -> NDArray[np.intp]:
    return np.argsort(-values if descending else values, kind="stable")


def column(store: Store, state: State, name: str) -> NDArray[np.float64]:
    """(N,) values of a column in the units of the index; for names their alphabetical rank."""
    truth, run = store.instances, store.run_columns(state.run)
    if name in NAMES:
        return _alphabetical_ranks(getattr(truth, name), getattr(truth, f"{name}_names"))
    if name in fields.RANKS:
        ranks = population_ranks(state.population, run, fields.RANKS[name])
        return np.where(ranks > 0, ranks, np.nan)
    values = np.asarray(fields.column(fields.NUMERIC[name].path, truth, run), dtype=np.float64)
    return np.where(values < 0, np.nan, values) if name in COUNTS else values


def _alphabetical_ranks(
    codes: NDArray[np.integer[Any]], names: Sequence[str]
) -> NDArray[np.float64]:
    """The alphabetical rank of each coded name; NaN for code -1, no name."""
    places = np.full(len(names) + 1, np.nan)
    places[sorted(range(len(names)), key=lambda code: names[code])] = np.arange(len(names))
    return places[codes]


def sort_by_next_column(context: SessionContext, state: State) -> State:
    """Sort by the next column, the largest first; ranks, counts and names ascend."""
    available = columns(context.store, context.notes)
    at = available.index(state.sort) + 1 if state.sort in available else 0
    name = available[at % len(available)]
    message = f"sorted by {fields.with_unit(name)}"
    return state.updated(sort=name, descending=name not in _ASCENDING, message=message)


def reverse(context: SessionContext, state: State) -> State:
    """Reverse the order of the list."""
    return state.updated(descending=not state.descending)


def to_end(context: SessionContext, state: State, last: bool) -> State:
    """Move the cursor to the first or the last row of the list."""
    rows = order(context.store, state, context.notes)
    if not rows.size:
        return state.with_message("nothing is selected")
    return state.updated(cursor=int(rows[-1 if last else 0]))


def move(context: SessionContext, state: State, steps: int) -> State:
    """Move the cursor to another row of the list."""
    rows = order(context.store, state, context.notes)
    if not rows.size:
        return state.with_message("nothing is selected")
    position = np.flatnonzero(rows == state.cursor)
    at = int(position[0]) if position.size else -1
    return state.updated(cursor=int(rows[min(max(at + steps, 0), rows.size - 1)]))
