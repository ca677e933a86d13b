"""What has yet to be read: awaited while a worker reads it, then turned to."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rstore.language import Node, Vocabulary, base_population, evaluation, mask, parse
from s2rstore.language.fields import NUMERIC, TEXT
from s2rstore.language.name_resolution import expand, used_fields
from s2rstore.language.syntax_tree import Bend, Extreme, Field, Like, leaves
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.session.run_differences import other_run
from s2rtui.session.state import PendingTarget, State

if TYPE_CHECKING:
    from s2rtui.session.session import Session

HISTORY = 100
"""Expressions of the past at most."""
AT_ONCE = 20_000
"""Columns of so many instances are read within a blink of the eye."""
_OF_SIDE = ("x", "y", "heading", "error", "heading_error", "room", "u", "v", "outlier")
_OF_BOTH = ("shift", "valid")
_OF_TRUTH = ("x", "y", "heading", "seq", "trajectory", "room", "curvature")


def is_ready(store: Store, run: str) -> bool:
    """Whether views can be drawn of a run at once."""
    if len(store.instances) <= AT_ONCE:
        return True
    sides = all(store.has_loaded(run, side, _OF_SIDE) for side in SIDES)
    return sides and store.has_loaded(run, None, _OF_BOTH)


def is_at_hand(store: Store, run: str, node: Node) -> bool:
    """Whether an expanded expression can be evaluated on a run at once."""
    if len(store.instances) <= AT_ONCE:
        return True
    return all(_has_read(store, run, leaf) for leaf in leaves(node))


def _has_read(store: Store, run: str, leaf: Node) -> bool:
    if isinstance(leaf, Like):
        return False  # compares embeddings
    if isinstance(leaf, Bend):
        return store.has_loaded(None, None, ["curvature"])
    if isinstance(leaf, Extreme) and not store.has_loaded(leaf.field.run or run, None, ["valid"]):
        return False  # looks for it in the base population
    return all(_has_read_field(store, run, used) for used in used_fields(leaf))


def _has_read_field(store: Store, run: str, used: Field) -> bool:
    path = NUMERIC[used.name].path if used.name in NUMERIC else TEXT[used.name].path
    owner, _, name = path.rpartition(".")
    side = next((side for side in SIDES if side == owner), None)
    of = None if owner == "instances" else used.run or run
    return path == "iid" or store.has_loaded(of, side, [name])


def here(state: State) -> PendingTarget:
    """Where a session is."""
    return PendingTarget(state.run, state.generation, trajectories=state.trajectories)


def bound(state: State) -> PendingTarget:
    """Where a session is on its way to, or is."""
    return state.awaited or here(state)


def only_place(there: PendingTarget) -> PendingTarget:
    """The same place, with the present expression."""
    return PendingTarget(there.run, there.generation, trajectories=there.trajectories)


def soon(state: State) -> State:
    """With the expression that is about to be selected, and its history."""
    there = state.awaited
    if there is None or not there.text:
        return state
    return replace(state, expression=there.text, past=there.past, future=there.future)


def step(state: State, place: PendingTarget, text: str) -> PendingTarget:
    """An expression to be selected somewhere, as the next one of the history."""
    before = soon(state)
    past, future = before.past, before.future
    if text != before.expression:
        past, future = (*past, before.expression)[-HISTORY:], ()
    return replace(only_place(place), text=text, past=past, future=future)


def expanded(session: Session, expression: str | Node) -> Node:
    """An expression with saved names put in their places. Raises ExpressionError."""
    words = evaluation.vocabulary(session.store, session.notes.nodes)
    return expand(parse(expression) if isinstance(expression, str) else expression, words)


def lacks(session: Session, there: PendingTarget, expression: Node | None = None) -> Node | None:
    """What is to be evaluated there, where a worker has to read before it can be.

    `expression` is by default that of the place, or the present one.

    Raises ExpressionError.
    """
    if not session.waits:
        return None
    state, store = session.state, session.store
    node = expanded(session, expression or there.text or state.expression)
    ready = there.run == state.run or is_ready(store, there.run)
    if there.generation != state.generation or not ready:
        return node
    return None if is_at_hand(store, there.run, node) else node


def read(store: Store, there: PendingTarget, wanted: Callable[[], bool]) -> None:
    """Read what views draw of a run, and evaluate what is to be selected there."""
    columns, truth = store.run_columns(there.run), store.instances
    sides = ((columns.side(side), _OF_SIDE) for side in SIDES)
    for owner, names in ((truth, _OF_TRUTH), (columns, _OF_BOTH), *sides):
        for name in names:
            if not wanted():
                return
            getattr(owner, name)
    with suppress(RequestError):  # it has no meaning here: told once it is turned to
        context = evaluation.context(store, there.run, there.trajectories)
        base_population(context)
        if there.node is not None:
            mask(there.node, context)


def in_use(state: State) -> frozenset[str]:
    """The runs whose columns are drawn, or will be soon."""
    awaited = state.awaited.run if state.awaited else None
    other = other_run(state) if state.centre == "compare" else None
    return frozenset(run for run in (state.run, awaited, other) if run is not None)


def lacking(store: Store, state: State) -> str | None:
    """The run that is compared with, where it has yet to be read."""
    other = other_run(state) if state.centre == "compare" else None
    return other if other is not None and not is_ready(store, other) else None


def expect(session: Session, there: PendingTarget) -> State:
    """Await a place, and what is to be selected there; the newest request wins."""
    state = session.state
    made = replace(state, awaited=there, message=_told(state, there), is_error=False)
    return session.set(made)


def expect_selection(session: Session, there: PendingTarget) -> State:
    """Await a selection, which uses brush and operator up."""
    session.set(replace(session.state, brush=None, operator="replace"))
    return expect(session, there)


def _told(state: State, there: PendingTarget) -> str:
    if there.generation != state.generation:
        return f"loading run {there.run} of generation {there.generation}"
    if there.run != state.run:
        return f"loading run {there.run}"
    return f"loading {there.text or state.expression}"


def superseded(state: State, node: Node, words: Vocabulary) -> PendingTarget | None:
    """What is still awaited once `node` is selected."""
    there = state.awaited
    if there is None or only_place(there) == here(state):
        return None
    return replace(only_place(there), node=expand(node, words))


def give_up(session: Session) -> State:
    """Stay where it is."""
    return session.set(replace(session.state, awaited=None))
