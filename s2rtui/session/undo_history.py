"""Undo and redo of selections: walk through the history of expressions."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from s2rstore.errors import RequestError
from s2rtui.session import pending_target
from s2rtui.session.context import SessionContext
from s2rtui.session.selection import select
from s2rtui.session.state import State


def undo(context: SessionContext, state: State) -> State:
    """Select the previous expression of the history that can still be evaluated."""
    return _walk_history(context, state, "undo")


def redo(context: SessionContext, state: State) -> State:
    """Select the next expression of the history that can still be evaluated."""
    return _walk_history(context, state, "redo")


def _walk_history(
    context: SessionContext, state: State, direction: Literal["undo", "redo"]
) -> State:
    """Skip expressions that cannot be evaluated here and name them in the message."""
    upcoming, backwards = pending_target.upcoming(state), direction == "undo"
    remaining, skipped = list(upcoming.past if backwards else upcoming.future), []
    place = pending_target.place_of(pending_target.final_target(state))
    while remaining:
        text = remaining.pop()
        past, future = tuple(remaining), (*upcoming.future, upcoming.expression)
        if not backwards:
            past, future = (*upcoming.past, upcoming.expression), tuple(remaining)
        target = replace(place, text=text, past=past, future=future)
        try:
            result = select(context, state, text, "replace", target)
        except RequestError as error:
            skipped.append(f"left out: {text} ({error})")
            continue
        message = "; ".join(part for part in (result.message, *skipped) if part)
        return replace(result, message=message)
    if upcoming is state:
        state = replace(state, past=()) if backwards else replace(state, future=())
    return state.with_message("; ".join((f"nothing to {direction}", *skipped)))
