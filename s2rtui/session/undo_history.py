"""The history of undo and redo: the steps before and after the present selection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

from s2rtui.session.state import History, State, Step, Target

MAX_HISTORY = 100
"""Number of past steps that can be undone."""
Direction = Literal["undo", "redo"]


def upcoming(state: State) -> State:
    """The state with the pending expression, place and history instead of the present ones."""
    target = state.pending
    if target is None:
        return state
    past, future = target.history or (state.past, state.future)
    return replace(
        state,
        node=target.node or state.node,
        run=target.run,
        trajectories=target.trajectories,
        with_trained=target.with_trained,
        past=past,
        future=future,
    )


def next_history(state: State, target: Target) -> History:
    """The history around a target that is shown after the present or pending one."""
    before = upcoming(state)
    node = target.node or before.node
    if Step(node, target.run, target.trajectories, target.with_trained) == before.step:
        return before.past, before.future
    return (*before.past, before.step)[-MAX_HISTORY:], ()


def walk(state: State, direction: Direction) -> Iterator[tuple[Step, Target]]:
    """Yield the steps before or after the upcoming state, the nearest first, and their targets."""
    present = upcoming(state)
    generation = (state.pending or state).generation
    remaining = list(present.past if direction == "undo" else present.future)
    while remaining:
        step = remaining.pop()
        history = tuple(remaining), (*present.future, present.step)
        if direction == "redo":
            history = (*present.past, present.step), tuple(remaining)
        yield step, Target(
            step.run, generation, step.node, trajectories=step.trajectories,
            with_trained=step.with_trained, history=history, cursor=step.cursor,
        )  # fmt: skip
