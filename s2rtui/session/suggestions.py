"""Reducers of the suggestions view: choose an answer, and show it as live adjustments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from s2rstore.records import Side
from s2rtui.session.context import SessionContext
from s2rtui.session.state import State


def choose(context: SessionContext, state: State, steps: int) -> State:
    """Choose another answer; the view takes the number modulo the number of answers."""
    return state.updated(suggestion=state.suggestion + steps)


def adjust(
    context: SessionContext, state: State, side: Side, chain: Sequence[Mapping[str, Any]]
) -> State:
    """Set the sliders, which are those of the present run, to a chain of a side.

    The order of its steps is kept. Nothing is set where a step has no slider; a message names it.
    """
    present = state.adjust
    if present is None or present.missing:
        return state
    values = {(side, str(step["name"])): float(step["value"]) for step in chain}
    known = dict(present.values)
    unknown = [name for key_side, name in values if (key_side, name) not in known]
    if unknown:
        names = ", ".join(unknown)
        return state.with_message(f"there is no slider for {names}", is_error=True)
    changed = [key for key, value in values.items() if value != known[key]]
    places = [at for at, slider in enumerate(present.sliders) if slider.key in changed]
    other = tuple(key for key in present.run_steps if key[0] != side)
    made = replace(
        present,
        values=tuple((known | values).items()),
        active=places[0] if places else present.active,
        run_steps=(*other, *values),
    )
    return state.updated(adjust=made)
