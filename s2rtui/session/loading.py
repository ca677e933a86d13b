"""Runs whose columns have yet to be read: awaited while a worker reads them, then turned to."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore import selection
from s2rstore.errors import RequestError
from s2rstore.language import Node, base_population, mask, parse
from s2rstore.language.context import expand, used_fields
from s2rstore.language.fields import NUMERIC, TEXT
from s2rstore.language.nodes import Bend, Field, Like, leaves
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.session.comparing import other_run
from s2rtui.session.state import Awaited, State, Step

if TYPE_CHECKING:
    from s2rtui.session.session import Session

AT_ONCE = 20_000
"""Columns of so many instances are read within a blink of the eye."""
_OF_SIDE = ("x", "y", "heading", "error", "heading_error", "room", "u", "v", "outlier")
_OF_BOTH = ("shift", "valid")
_OF_TRUTH = ("x", "y", "heading", "seq", "trajectory", "room", "curvature")


def is_ready(store: Store, run: str) -> bool:
    """Whether views can be drawn of a run at once."""
    if len(store.instances) <= AT_ONCE:
        return True
    sides = all(store.has_read(run, side, _OF_SIDE) for side in SIDES)
    return sides and store.has_read(run, None, _OF_BOTH)


def is_at_hand(store: Store, run: str, node: Node) -> bool:
    """Whether an expanded expression can be evaluated on a run at once."""
    if len(store.instances) <= AT_ONCE:
        return True
    return all(_has_read(store, run, leaf) for leaf in leaves(node))


def _has_read(store: Store, run: str, leaf: Node) -> bool:
    if isinstance(leaf, Like):
        return False  # compares embeddings
    if isinstance(leaf, Bend):
        return store.has_read(None, None, ["curvature"])
    return all(_has_read_field(store, run, used) for used in used_fields(leaf))


def _has_read_field(store: Store, run: str, used: Field) -> bool:
    path = NUMERIC[used.name].path if used.name in NUMERIC else TEXT[used.name].path
    owner, _, name = path.rpartition(".")
    side = next((side for side in SIDES if side == owner), None)
    of = None if owner == "instances" else used.run or run
    return path == "iid" or store.has_read(of, side, [name])


def lacks(session: Session, run: str, expression: str | Node) -> Node | None:
    """An expression, expanded, where a worker has to read before it can be evaluated on a run.

    Raises ExpressionError.
    """
    if not session.waits:
        return None
    words = selection.vocabulary(session.store, session.notes.nodes)
    node = expand(parse(expression) if isinstance(expression, str) else expression, words)
    ready = run == session.state.run or is_ready(session.store, run)
    return None if ready and is_at_hand(session.store, run, node) else node


def bound_for(session: Session) -> tuple[str, int]:
    """The run and the generation that the session is in, or on its way to."""
    there = session.state.awaited or session.state
    return there.run, there.generation


def read(store: Store, state: State, run: str, wanted: Callable[[], bool]) -> None:
    """Read what views draw of a run, and evaluate the state's expression on it."""
    columns, truth = store.run_columns(run), store.instances
    sides = ((columns.side(side), _OF_SIDE) for side in SIDES)
    for owner, names in ((truth, _OF_TRUTH), (columns, _OF_BOTH), *sides):
        for name in names:
            if not wanted():
                return
            getattr(owner, name)
    with suppress(RequestError):  # a saved name, or no meaning here: told once it is turned to
        context = selection.context(store, run, state.trajectories)
        base_population(context)
        awaited = state.awaited.node if state.awaited else None
        mask(awaited or parse(state.expression), context)


def in_use(state: State) -> frozenset[str]:
    """The runs whose columns are drawn, or will be soon."""
    awaited = state.awaited.run if state.awaited else None
    other = other_run(state) if state.centre == "compare" else None
    return frozenset(run for run in (state.run, awaited, other) if run is not None)


def lacking(store: Store, state: State) -> str | None:
    """The run that is compared with, where it has yet to be read."""
    other = other_run(state) if state.centre == "compare" else None
    return other if other is not None and not is_ready(store, other) else None


def expect(
    session: Session,
    run: str,
    generation: int,
    text: str = "",
    node: Node | None = None,
    step: Step | None = None,
    steps: int = 1,
) -> State:
    """Await a run, and what is to be selected there; the newest request wins.

    What is to be selected uses brush and operator up, as a selection does.
    """
    state = session.state
    told = f"loading run {run}" if run != state.run else f"loading {text}"
    if generation != state.generation:
        told = f"loading run {run} of generation {generation}"
    if text:
        state = replace(state, brush=None, operator="replace")
    awaited = Awaited(run, generation, text, node, step, steps)
    return session.set(replace(state, awaited=awaited, message=told, is_error=False))


def superseded(state: State) -> Awaited | None:
    """What is still awaited once something else is selected."""
    awaited = state.awaited
    if awaited is None or not awaited.text:
        return awaited
    if (awaited.run, awaited.generation) == (state.run, state.generation):
        return None
    return Awaited(awaited.run, awaited.generation)


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


def take_back(session: Session) -> State:
    """Have nothing selected there; what the session is on its way to is still awaited."""
    state = session.state
    return session.set(replace(state, awaited=superseded(state), message="", is_error=False))
