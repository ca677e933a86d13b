"""Adjusting live: sliders with values, and the chains of adjustments that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.session.session import Session
from s2rtui.session.state import Adjust, Slider, State


def sliders(store: Store) -> tuple[tuple[Slider, ...], str]:
    """What can be adjusted on this store, and why other things cannot be.

    Images on the real side; the camera on the sim side where the data set has a renderer. Raises
    ModuleNotFoundError where the tools are not installed.
    """
    from s2rtools.adjustments import ADJUSTMENTS
    from s2rtools.rendering import no_renderer_reason

    reason = (no_renderer_reason(store) or "").removeprefix(f"{store.path}: ")
    found: list[Slider] = []
    for adjustment in ADJUSTMENTS.values():
        side: Side = "sim" if adjustment.needs_renderer else "real"
        if side in adjustment.sides and not (adjustment.needs_renderer and reason):
            found.append(
                Slider(
                    side, adjustment.name, adjustment.lowest, adjustment.highest,
                    adjustment.neutral, adjustment.step, adjustment.unit,
                )
            )  # fmt: skip
    return tuple(found), reason


def begin(session: Session, found: tuple[Slider, ...], reason: str) -> State:
    """Sliders at the values of the present run."""
    return session.set(replace(session.state, adjust=_fresh(session, found, reason)))


def lack(session: Session, package: str) -> State:
    """The panel without a package that it needs."""
    missing = f"adjusting live needs {package}: pip install 's2rtui[tools]'"
    return session.set(replace(session.state, adjust=Adjust(session.state.run, missing=missing)))


def _fresh(session: Session, found: Sequence[Slider], reason: str) -> Adjust:
    run = session.store.run(session.state.run)
    values = {slider.key: slider.neutral for slider in found}
    own = [((s, str(step["name"])), step["value"]) for s in SIDES for step in run.adjustments(s)]
    values |= {key: float(value) for key, value in own}
    keys = tuple(key for key, _ in own)
    return Adjust(session.state.run, tuple(values.items()), 0, tuple(found), reason, own=keys)


def follow(session: Session) -> State:
    """Begin anew where the run has changed since; what is missing is so for every run."""
    adjust, run = session.state.adjust, session.state.run
    if adjust is None or adjust.run == run:
        return session.state
    fresh = _fresh(session, adjust.sliders, adjust.reason)
    made = replace(adjust, run=run) if adjust.missing else fresh
    return session.set(replace(session.state, adjust=made))


def choose(session: Session, steps: int) -> State:
    """Another slider."""
    adjust = session.state.adjust
    if adjust is None or not adjust.sliders:
        return session.state
    active = (adjust.active + steps) % len(adjust.sliders)
    return session.change(adjust=replace(adjust, active=active))


def move(session: Session, steps: int) -> State:
    """The active slider by steps."""
    adjust = session.state.adjust
    if adjust is None or not adjust.sliders:
        return session.state
    slider = adjust.sliders[adjust.active]
    return put(session, adjust.active, adjust.value(slider.key) + steps * slider.step)


def put(session: Session, index: int, value: float) -> State:
    """A slider to a value."""
    adjust = session.state.adjust
    if adjust is None:
        return session.state
    slider = adjust.sliders[index]
    values = {**dict(adjust.values), slider.key: slider.clipped(value)}
    return session.change(adjust=replace(adjust, values=tuple(values.items()), active=index))


def reset(session: Session) -> State:
    """Every slider to neutral."""
    adjust = session.state.adjust
    if adjust is None:
        return session.state
    values = dict(adjust.values) | {slider.key: slider.neutral for slider in adjust.sliders}
    return session.change(adjust=replace(adjust, values=tuple(values.items())))


def chains(adjust: Adjust) -> dict[Side, list[dict[str, Any]]]:
    """The chains that the sliders stand for, in the order of the run's where that is its own.

    Raises RequestError for a run that takes a step twice, which sliders cannot show.
    """
    from s2rtools.adjustments import ADJUSTMENTS, make_chain

    made: dict[Side, list[dict[str, Any]]] = {}
    for side in SIDES:
        own = [name for of, name in adjust.own if of == side]
        if len(set(own)) < len(own):
            raise RequestError(f"run {adjust.run}: takes a step twice, which sliders cannot show")
        chain = make_chain(side, {name: value for (of, name), value in adjust.values if of == side})
        if own != [name for name in ADJUSTMENTS if name in own]:
            first = [step for name in own for step in chain if step["name"] == name]
            chain = [*first, *(step for step in chain if step["name"] not in own)]
        made[side] = chain
    return made
