"""Back and forth among the expressions that were selected."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rtui.session import loading
from s2rtui.session.state import State, Step

if TYPE_CHECKING:
    from s2rtui.session.session import Session


def walk(session: Session, what: Step, at_once: bool = False) -> State:
    """To the nearest expression that still means something here; the rest is told.

    Awaited where a worker has to read for it, unless it is wanted `at_once`.
    """
    before = session.state
    left, lost = list(before.past if what == "undo" else before.future), [""]
    while left:
        text = left.pop()
        try:
            node = None if at_once else loading.lacks(session, before.run, text)
            if node is not None:
                newest = loading.newest(session)
                return loading.expect(session, before.run, newest, text, node, what)
            made = session.selected(before, text)
        except RequestError as error:
            lost.append(f"left out: {text} ({error})")
            continue
        told = "; ".join(part for part in (made.message, *lost) if part)
        past, future = tuple(left), (*before.future, before.expression)
        if what == "redo":
            past, future = (*before.past, before.expression), tuple(left)
        return session.set(replace(made, past=past, future=future, message=told))
    kept = replace(before, past=() if what == "undo" else before.past)
    session.set(replace(kept, future=() if what == "redo" else kept.future))
    return session.tell("; ".join((f"nothing to {what}", *lost[1:])))
