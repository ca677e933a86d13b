"""Undo and redo: walk through the history of selections, runs and trajectories."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from s2rstore.errors import RequestError
from s2rtui.session import navigation, targets
from s2rtui.session.context import SessionContext
from s2rtui.session.state import State, Target


def undo(context: SessionContext, state: State) -> State:
    """Show the previous step of the history that can still be evaluated."""
    return _walk_history(context, state, "undo")


def redo(context: SessionContext, state: State) -> State:
    """Show the next step of the history that can still be evaluated."""
    return _walk_history(context, state, "redo")


def _walk_history(
    context: SessionContext, state: State, direction: Literal["undo", "redo"]
) -> State:
    """Skip expressions that cannot be evaluated any more and name them in the message."""
    upcoming, backwards = targets.upcoming(state), direction == "undo"
    generation = targets.final(state).generation
    remaining, skipped = list(upcoming.past if backwards else upcoming.future), []
    while remaining:
        step = remaining.pop()
        history = tuple(remaining), (*upcoming.future, upcoming.step)
        if not backwards:
            history = (*upcoming.past, upcoming.step), tuple(remaining)
        target = Target(
            step.run, generation, step.node, trajectories=step.trajectories,
            with_trained=step.with_trained, history=history, cursor=step.cursor,
        )  # fmt: skip
        try:
            result = navigation.select_at(context, state, target)
        except RequestError as error:
            skipped.append(f"left out: {step.expression} ({error})")
            continue
        changed = "" if step.with_trained == upcoming.with_trained else result.population_message
        message = "; ".join(part for part in (result.message, changed, *skipped) if part)
        return replace(result, message=message)
    if upcoming is state:
        state = replace(state, past=()) if backwards else replace(state, future=())
    return state.with_message("; ".join((f"nothing to {direction}", *skipped)))
