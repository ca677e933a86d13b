"""Back and forth among the expressions that were selected."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from s2rstore.errors import RequestError
from s2rstore.language import parse
from s2rtui.session import navigation, pending_target
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtui.session.session import Session


def walk(session: Session, what: Literal["undo", "redo"]) -> State:
    """To the nearest expression that still means something here; the rest is told."""
    soon, back = pending_target.soon(session.state), what == "undo"
    left, lost = list(soon.past if back else soon.future), []
    place = pending_target.only_place(pending_target.bound(session.state))
    while left:
        text = left.pop()
        past, future = tuple(left), (*soon.future, soon.expression)
        if not back:
            past, future = (*soon.past, soon.expression), tuple(left)
        there = replace(place, text=text, past=past, future=future)
        try:
            state = navigation.put(session, there, parse(text))
        except RequestError as error:
            lost.append(f"left out: {text} ({error})")
            continue
        told = "; ".join(part for part in (state.message, *lost) if part)
        return session.set(replace(state, message=told))
    if soon is session.state:
        emptied = replace(soon, past=()) if back else replace(soon, future=())
        session.set(emptied)
    return session.tell("; ".join((f"nothing to {what}", *lost)))
