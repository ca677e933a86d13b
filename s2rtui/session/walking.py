"""Back and forth among the expressions that were selected."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rtui.session import loading
from s2rtui.session.state import State, Step

if TYPE_CHECKING:
    from s2rtui.session.session import Session


def walk(session: Session, what: Step) -> State:
    """One step further than the session is, or is on its way to."""
    awaited = session.state.awaited
    if awaited is None or not awaited.text:
        return go(session, what)
    if awaited.step == what:
        return go(session, what, awaited.steps + 1)
    if what == "undo" or awaited.step is not None:
        return loading.take_back(session)
    return go(session, what)


def go(session: Session, what: Step, steps: int = 1, at_once: bool = False) -> State:
    """So many steps, to the nearest expression that still means something here; the rest is told.

    Awaited where a worker has to read for it, unless it is wanted `at_once`.
    """
    before = session.state
    left, lost = list(before.past if what == "undo" else before.future), [""]
    passed = [before.expression]
    while left:
        text = left.pop()
        if len(passed) < steps and left:
            passed.append(text)
            continue
        try:
            node = None if at_once else loading.lacks(session, before.run, text)
            if node is not None:
                there = loading.bound_for(session)
                return loading.expect(session, *there, text, node, what, len(passed))
            made = session.selected(before, text)
        except RequestError as error:
            lost.append(f"left out: {text} ({error})")
            continue
        told = "; ".join(part for part in (made.message, *lost) if part)
        past, future = tuple(left), (*before.future, *passed)
        if what == "redo":
            past, future = (*before.past, *passed), tuple(left)
        return session.set(replace(made, past=past, future=future, message=told))
    if steps > 1:
        return go(session, what, steps - 1, at_once)
    kept = replace(before, past=() if what == "undo" else before.past)
    session.set(replace(kept, future=() if what == "redo" else kept.future))
    return session.tell("; ".join((f"nothing to {what}", *lost[1:])))
