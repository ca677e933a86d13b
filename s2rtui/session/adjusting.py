"""Live adjustments: reducers of the sliders, and the adjustment chains they describe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.session.context import SessionContext
from s2rtui.session.state import Adjust, Slider, State

if TYPE_CHECKING:
    from s2rtools.adjustments import Adjustment


def available_sliders(store: Store, run: str | None = None) -> tuple[tuple[Slider, ...], str]:
    """The sliders that a store and the model of a run support, and why others are not available.

    Image adjustments apply to the real side, camera adjustments to the sim side if the data set has
    a renderer. Each translator has a slider of its strength on the side whose images it
    translates, except the identity and those that failed a check of their content. Adjustments of
    images that the model does not take are left out. Raises ModuleNotFoundError if the tools are
    not installed.
    """
    from s2rtools.adjustments import ADJUSTMENTS, TranslatorAdjustment
    from s2rtools.synthetic_world.stored_world import no_renderer_reason

    model = None if run is None else store.run(run).model
    channels = "rgbd" if model is None else store.models[model].channels
    reason = (no_renderer_reason(store) or "").removeprefix(f"{store.path}: ")
    if channels != "rgbd":
        seen = {"rgb": "no depth", "depth": "no colours"}[channels]
        reason = "; ".join(part for part in (f"the model takes {seen}", reason) if part)
    sliders: list[Slider] = []
    translators: list[Slider] = []
    for adjustment in ADJUSTMENTS.values():
        if not adjustment.changes(channels):
            continue
        side: Side = "sim" if adjustment.needs_renderer else "real"
        if isinstance(adjustment, TranslatorAdjustment):
            translators = [
                _slider(adjustment, record.side, f"{adjustment.name}:{record.translator}")
                for record in store.translators.values()
                if record.accepted is not False and record.method != "identity"
            ]  # fmt: skip
        elif side in adjustment.sides and not (adjustment.needs_renderer and reason):
            sliders.append(_slider(adjustment, side, adjustment.name))
    return (*sliders, *translators), reason


def _slider(adjustment: Adjustment, side: Side, name: str) -> Slider:
    return Slider(
        side, name, adjustment.lowest, adjustment.highest, adjustment.neutral, adjustment.step,
        adjustment.unit,
    )  # fmt: skip


def open_sliders(
    context: SessionContext, state: State, sliders: tuple[Slider, ...], reason: str
) -> State:
    """Show sliders at the values of the present run."""
    run = context.store.run(state.run)
    values = {slider.key: slider.neutral for slider in sliders}
    steps = [((s, str(step["name"])), step["value"]) for s in SIDES for step in run.adjustments(s)]
    values |= {key: float(value) for key, value in steps}
    keys = tuple(key for key, _ in steps)
    adjust = Adjust(state.run, tuple(values.items()), 0, sliders, reason, run_steps=keys)
    return replace(state, adjust=adjust)


def report_missing_package(context: SessionContext, state: State, package: str) -> State:
    """Show in the panel which package has to be installed."""
    missing = f"live adjustments need {package}: pip install 's2rtui[tools]'"
    return replace(state, adjust=Adjust(state.run, missing=missing))


def follow_run(context: SessionContext, state: State) -> State:
    """Reset the sliders to the present run if it has changed since they were opened."""
    adjust = state.adjust
    if adjust is None or adjust.run == state.run:
        return state
    if adjust.missing:
        return replace(state, adjust=replace(adjust, run=state.run))
    return open_sliders(context, state, *available_sliders(context.store, state.run))


def choose_slider(context: SessionContext, state: State, steps: int) -> State:
    """Make the next slider the active one."""
    adjust = state.adjust
    if adjust is None or not adjust.sliders:
        return state
    active = (adjust.active + steps) % len(adjust.sliders)
    return state.updated(adjust=replace(adjust, active=active))


def move_slider(context: SessionContext, state: State, steps: int) -> State:
    """Move the active slider by steps."""
    adjust = state.adjust
    if adjust is None or not adjust.sliders:
        return state
    slider = adjust.sliders[adjust.active]
    value = adjust.value(slider.key) + steps * slider.step
    return set_slider(context, state, adjust.active, value)


def set_slider(context: SessionContext, state: State, index: int, value: float) -> State:
    """Set a slider to a value and make it the active one."""
    adjust = state.adjust
    if adjust is None:
        return state
    slider = adjust.sliders[index]
    values = {**dict(adjust.values), slider.key: slider.clipped(value)}
    return state.updated(adjust=replace(adjust, values=tuple(values.items()), active=index))


def reset_sliders(context: SessionContext, state: State) -> State:
    """Set every slider to its neutral value."""
    adjust = state.adjust
    if adjust is None:
        return state
    values = dict(adjust.values) | {slider.key: slider.neutral for slider in adjust.sliders}
    return state.updated(adjust=replace(adjust, values=tuple(values.items())))


def set_chain(
    context: SessionContext, state: State, side: Side, chain: Sequence[Mapping[str, Any]]
) -> State:
    """Set the sliders of the present run to a chain of a side.

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


def adjustment_chains(store: Store, adjust: Adjust) -> dict[Side, list[dict[str, Any]]]:
    """The adjustment chain per side that the sliders describe, the steps of the run first.

    Raises RequestError for a run that applies an adjustment twice, which sliders cannot show, and
    for a translator of another domain than the run's.
    """
    from s2rtools.adjustments import chain_position, make_chain, translator_name

    chains: dict[Side, list[dict[str, Any]]] = {}
    for side in SIDES:
        steps = [name for step_side, name in adjust.run_steps if step_side == side]
        if len(set(steps)) < len(steps):
            raise RequestError(
                f"run {adjust.run}: applies an adjustment twice, which sliders cannot show"
            )
        values = {name: value for (owner, name), value in adjust.values if owner == side}
        chain = make_chain(side, values, store.translators)
        domain = store.run(adjust.run).domain(side)
        for name in filter(None, (translator_name(str(step["name"])) for step in chain)):
            source = store.translators[name].source_domain
            if source != domain:
                raise RequestError(
                    f"translator {name}: translates images of {source}, not {domain}"
                )
        if steps != sorted(steps, key=chain_position):
            first = [step for name in steps for step in chain if step["name"] == name]
            chain = [*first, *(step for step in chain if step["name"] not in steps)]
        chains[side] = chain
    return chains
