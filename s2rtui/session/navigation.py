"""From one place to another: a run, trajectories, and what is selected there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rstore.language import Node, parse, to_text
from s2rstore.reader import Store
from s2rtui.session import pending_target, saved_selection_diff
from s2rtui.session.heatmaps import with_heat
from s2rtui.session.state import PendingTarget, State

if TYPE_CHECKING:
    from s2rtui.session.session import Session


def select(session: Session, expression: str | Node) -> State:
    """Select at once, or where the session is on its way to once a worker has read for it.

    Raises ExpressionError; the state stays as it was.
    """
    node = parse(expression) if isinstance(expression, str) else expression
    place = pending_target.bound(session.state)
    return put(session, pending_target.step(session.state, place, to_text(node)), node)


def put(session: Session, there: PendingTarget, expression: Node) -> State:
    """Select what is to be selected there; at once, where nothing has to be read for it here.

    Raises ExpressionError; the state stays as it was.
    """
    state = session.state
    if (node := pending_target.lacks(session, pending_target.here(state), expression)) is not None:
        return pending_target.expect_selection(session, replace(there, node=node))
    made = session.selected(state, expression)
    return session.set(replace(made, past=there.past, future=there.future))


def take(session: Session, there: PendingTarget) -> State:
    """Select somewhere, at once or once a worker has read for it.

    Raises RequestError where that means nothing; the state stays as it was.
    """
    if (node := pending_target.lacks(session, there)) is None:
        return session.set(_settled(session, session.state, there))
    return pending_target.expect_selection(session, replace(there, node=node))


def move(session: Session, there: PendingTarget) -> State:
    """Be elsewhere, at once as far as that can be; the rest is awaited. What is begun goes on."""
    if (node := _lacks(session, there)) is None:
        return session.set(begun(session.state, settled(session, session.state, there)))
    here, place = pending_target.here(session.state), pending_target.only_place(there)
    for nearer in (place, replace(here, trajectories=there.trajectories)):
        if nearer != here and _lacks(session, nearer) is None:
            session.set(begun(session.state, settled(session, session.state, nearer)))
            break
    return pending_target.expect(session, replace(there, node=node))


def arrive(session: Session, fresh: Store | None = None) -> State:
    """Be where the session is on its way to; what is begun goes on, what no key has taken away is
    still told.

    `fresh` is the open store of that generation, where it is newer.
    """
    state, told = session.state, session.told
    if fresh is not None:
        session.enter(fresh)
    elif state.awaited is not None:
        session.set(begun(state, settled(session, state, state.awaited)))
    if not told or session.state is state:
        return session.state
    made = session.state
    words = "; ".join(part for part in (told, made.message) if part)
    return session.set(replace(made, message=words, is_error=state.is_error or made.is_error))


def renew(session: Session) -> State:
    """What is selected, and what is to be, evaluated anew after saved names have changed.

    Raises RequestError where it means nothing any more; the state stays as it was.
    """
    state = session.state
    if "@" in state.expression:
        here = pending_target.here(state)
        if (node := pending_target.lacks(session, here)) is None:
            made = begun(state, session.selected(state, state.expression))
            session.set(replace(made, awaited=state.awaited))
        elif state.awaited is None:
            return pending_target.expect(session, replace(here, node=node))
    if (there := session.state.awaited) is not None:
        node = pending_target.expanded(session, there.text or state.expression)
        session.set(replace(session.state, awaited=replace(there, node=node)))
    return session.state


def begun(before: State, after: State) -> State:
    """With the brush and the operator of before."""
    return replace(after, brush=before.brush, operator=before.operator)


def settled(session: Session, base: State, there: PendingTarget) -> State:
    """The state there, from one whose generation is that of the store.

    Where what was to be selected means nothing there, that is told, and it is left out.
    """
    try:
        return _settled(session, base, there)
    except RequestError as error:
        made = _settled(session, base, pending_target.only_place(there))
        past, future = (
            tuple(t for t in side if t != there.text) for side in (made.past, made.future)
        )
        return replace(made, past=past, future=future, message=str(error), is_error=True)


def _settled(session: Session, base: State, there: PendingTarget) -> State:
    run = there.run if there.run in base.runs else base.run
    place = replace(base, run=run, trajectories=there.trajectories, awaited=None)
    if there.text:
        made = session.selected(place, there.text)
        made = replace(made, past=there.past, future=there.future)
    else:
        made = session.kept(place)
    if there.saved is not None:
        made = replace(made, message=saved_selection_diff.taken(made, base, there.saved))
    return with_heat(session.store, made)


def _lacks(session: Session, there: PendingTarget) -> Node | None:
    """See `loading.lacks`; what means nothing is told once it is there."""
    try:
        return pending_target.lacks(session, there)
    except RequestError:
        return pending_target.lacks(session, replace(there, text="all"))
