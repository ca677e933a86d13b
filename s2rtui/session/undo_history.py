"""Undo and redo of selections: walk through the history of expressions."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from s2rstore.errors import RequestError
from s2rtui.session import pending_target
from s2rtui.session.context import SessionContext
from s2rtui.session.selection import select
from s2rtui.session.state import State, Step


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
        step = remaining.pop()
        past, future = tuple(remaining), (*upcoming.future, upcoming.step)
        if not backwards:
            past, future = (*upcoming.past, upcoming.step), tuple(remaining)
        target = replace(
            place, text=step.expression, with_trained=step.with_trained, past=past, future=future
        )
        try:
            result = select(
                context, _with_population(state, step), step.expression, "replace", target
            )
        except RequestError as error:
            skipped.append(f"left out: {step.expression} ({error})")
            continue
        changed = "" if step.with_trained == upcoming.with_trained else result.population_message
        message = "; ".join(part for part in (result.message, changed, *skipped) if part)
        return replace(result, message=message)
    if upcoming is state:
        state = replace(state, past=()) if backwards else replace(state, future=())
    return state.with_message("; ".join((f"nothing to {direction}", *skipped)))


def _with_population(state: State, step: Step) -> State:
    """The state, and what is pending, with the population of a step of the history."""
    pending = state.pending and replace(state.pending, with_trained=step.with_trained)
    return replace(state, with_trained=step.with_trained, pending=pending)
