"""Runs whose columns have yet to be read: awaited while a worker reads them, then turned to."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore import selection
from s2rstore.errors import RequestError
from s2rstore.language import base_population, mask, parse
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.session.comparing import other_run
from s2rtui.session.state import Awaited, State

if TYPE_CHECKING:
    from s2rtui.session.session import Session

AT_ONCE = 20_000
"""Columns of so many instances are read within a blink of the eye."""
_OF_SIDE = ("x", "y", "heading", "error", "heading_error", "room", "u", "v")
_OF_BOTH = ("shift", "valid")


def is_ready(store: Store, run: str) -> bool:
    """Whether views can be drawn of a run at once."""
    if len(store.instances) <= AT_ONCE:
        return True
    sides = all(store.has_read(run, side, _OF_SIDE) for side in SIDES)
    return sides and store.has_read(run, None, _OF_BOTH)


def read(store: Store, state: State, run: str, wanted: Callable[[], bool]) -> None:
    """Read what views draw of a run, and evaluate the state's expression on it."""
    columns = store.run_columns(run)
    for owner, names in ((columns, _OF_BOTH), *((columns.side(s), _OF_SIDE) for s in SIDES)):
        for name in names:
            if not wanted():
                return
            getattr(owner, name)
    with suppress(RequestError):  # a saved name, or no meaning here: told once it is turned to
        context = selection.context(store, run, state.trajectories)
        base_population(context)
        mask(parse(state.expression), context)


def in_use(state: State) -> frozenset[str]:
    """The runs whose columns are drawn, or will be soon."""
    awaited = state.awaited.run if state.awaited else None
    other = other_run(state) if state.centre == "compare" else None
    return frozenset(run for run in (state.run, awaited, other) if run is not None)


def lacking(store: Store, state: State) -> str | None:
    """The run that is compared with, where it has yet to be read."""
    other = other_run(state) if state.centre == "compare" else None
    return other if other is not None and not is_ready(store, other) else None


def expect(session: Session, run: str, generation: int) -> State:
    """Await a run; the newest request wins."""
    told = f"loading run {run}"
    if generation != session.state.generation:
        told += f" of generation {generation}"
    awaited = Awaited(run, generation)
    return session.set(replace(session.state, awaited=awaited, message=told, is_error=False))


def arrive(session: Session, fresh: Store | None = None) -> State:
    """Turn to the awaited run, what is begun going on; `fresh` is the open store of its generation,
    where that is newer.
    """
    awaited = session.state.awaited
    session.set(replace(session.state, awaited=None))
    if fresh is not None:
        session.enter(fresh)
    before = session.state
    refused = fresh is not None and session.store is not fresh
    if awaited is None or refused or awaited.run not in before.runs or awaited.run == before.run:
        return before
    message = before.message if fresh is not None else ""
    state = session.turn_to(awaited.run)
    begun = replace(state, brush=before.brush, operator=before.operator)
    return session.set(replace(begun, message=message or state.message))


def give_up(session: Session) -> State:
    """Stay where it is."""
    return session.set(replace(session.state, awaited=None))
