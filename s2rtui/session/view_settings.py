"""Reducers of the display: heatmaps, map and views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from s2rstore.heatmap_kinds import NO_HEAT
from s2rstore.metrics import heatmap_scores
from s2rstore.records import Side
from s2rtui.analysis.map_frame import centred_within, panned, zoomed
from s2rtui.session.context import SessionContext
from s2rtui.session.heatmaps import heatmap_choices, sample_note
from s2rtui.session.run_comparison import other_run
from s2rtui.session.state import AGGREGATES, MAP_MODES, OVERLAYS, Brush, State

CLOSEST = 1 / 200
"""Smallest share of the map that zooming in shows."""
T = TypeVar("T")


def _next(options: Sequence[T], present: T, steps: int = 1) -> T:
    return options[(options.index(present) + steps) % len(options)]


def change_heat(context: SessionContext, state: State, steps: int) -> State:
    """Show the next heatmap kind."""
    return _change_heat(context, state, steps, same_kind=False)


def change_mode(context: SessionContext, state: State) -> State:
    """Show the next mode of the same heatmap kind."""
    return _change_heat(context, state, 1, same_kind=True)


def _change_heat(context: SessionContext, state: State, steps: int, same_kind: bool) -> State:
    heat = state.heat
    options = heatmap_choices(context.store, state.run)
    if heat is None or not options:
        return state.with_message(f"run {state.run} has no heatmaps; `s2r precompute` makes them")
    options.append((NO_HEAT, None))
    if same_kind:
        modes = [mode for kind, mode in options if kind == heat.kind]
        choice = replace(heat, mode=_next(modes, heat.mode))
    else:
        kind = _next(list(dict.fromkeys(kind for kind, _ in options)), heat.kind, steps)
        choice = replace(heat, kind=kind, mode=next(m for k, m in options if k == kind))
    trust = heatmap_scores.trust_line(context.store, state.run, choice.kind, choice.mode)
    message = choice.label if choice.kind == NO_HEAT else f"{choice.label}: {trust}".rstrip(": ")
    return state.updated(heat=choice, message=message)


def change_side(context: SessionContext, state: State) -> State:
    """Switch the side whose heatmaps are shown: real or sim."""
    if state.heat is None:
        return state.with_message("no heatmaps")
    side: Side = "sim" if state.heat.side == "real" else "real"
    heat = replace(state.heat, side=side)
    return state.updated(heat=heat, message=f"heat of the {side} side")


def change_overlay(context: SessionContext, state: State) -> State:
    """Cycle the heat on the map: none, of the instance, of the selection, of the run."""
    if state.shown_heat is None:
        return state.with_message("no heatmap is chosen" if state.heat else "no heatmaps")
    overlay = _next(OVERLAYS, state.overlay)
    messages = {
        "off": "heat off",
        "instance": "heat of this instance",
        "selection": f"heat of the selection ({state.aggregate})" + sample_note(state),
        "run": f"heat of the whole run ({state.aggregate})",
    }
    return state.updated(overlay=overlay, message=messages[overlay])


def change_aggregate(context: SessionContext, state: State) -> State:
    """Cycle how heat is aggregated per cell of the map."""
    aggregate = _next(AGGREGATES, state.aggregate)
    return state.updated(aggregate=aggregate, message=f"heat: {aggregate}")


def change_map_mode(context: SessionContext, state: State) -> State:
    """Show the next map mode: colour, glyph or full."""
    mode = _next(MAP_MODES, state.map_mode)
    messages = {
        "colour": "truth coloured by the shift",
        "glyph": "direction and size of both errors",
        "full": "sim, truth and real",
    }
    return state.updated(map_mode=mode, message=f"map: {messages[mode]}")


def toggle_clip(context: SessionContext, state: State) -> State:
    """Dim the floor that no selected instance has seen, or show all of it."""
    clip = not state.clip
    message = "only the floor seen in the selection" if clip else "the whole map"
    return state.updated(clip=clip, message=message)


def toggle_room_names(context: SessionContext, state: State) -> State:
    return state.updated(room_names=not state.room_names)


def zoom(
    context: SessionContext, state: State, factor: float, at: tuple[float, float] | None = None
) -> State:
    """Zoom the map by a factor around a point in metres, by default the cursor.

    Factor 0, or zooming out far enough, shows the whole map.
    """
    bounds = context.store.dataset.bounds
    if factor == 0:
        return state.updated(viewport=None)
    view = state.viewport or bounds
    truth, cursor = context.store.instances, state.cursor
    if at is None and cursor is not None:
        at = float(truth.x[cursor]), float(truth.y[cursor])
    share = max(view.width / max(bounds.width, 1e-9), view.height / max(bounds.height, 1e-9))
    factor = min(factor, share / CLOSEST)
    if share / factor >= 1:
        return state.updated(viewport=None)
    return state.updated(viewport=centred_within(zoomed(view, factor, at), bounds))


def pan(context: SessionContext, state: State, across: float, down: float) -> State:
    """Move the viewport by shares of its size; its centre stays on the map."""
    bounds = context.store.dataset.bounds
    view = state.viewport or bounds
    moved = panned(view, across, down, context.store.dataset.y_down)
    return state.updated(viewport=centred_within(moved, bounds))


def change_other(context: SessionContext, state: State, steps: int = 1) -> State:
    """Compare with the next run."""
    others = [name for name in state.runs if name != state.run]
    if not others:
        return state.with_message("there is no other run to compare with")
    present = other_run(state)
    other = others[0] if present is None else _next(others, present, steps)
    return state.updated(other=other, message=f"compared with {other}")


def show_view(context: SessionContext, state: State, name: str, pane: str) -> State:
    """Show a view in its pane and send the keys to it."""
    centre = name if pane == "centre" else state.centre
    tab = name if pane == "tab" else state.tab
    return state.updated(view=name, centre=centre, tab=tab, brush=None)


def activate(context: SessionContext, state: State, name: str) -> State:
    """Send the keys to a view that is on the screen; the layout stays."""
    if state.view == name:
        return state
    return state.updated(view=name, brush=None)


def set_brush(context: SessionContext, state: State, brush: Brush | None) -> State:
    """Show an unfinished brush, or none."""
    return state.updated(brush=brush)


def drop_brush(context: SessionContext, state: State) -> State:
    """Remove the brush and keep the message."""
    return replace(state, brush=None)


def toggle_lasso(context: SessionContext, state: State) -> State:
    """Brush with a lasso, or with a box."""
    message = "brushes draw a box" if state.lasso else "brushes draw a lasso"
    return state.updated(lasso=not state.lasso, brush=None, message=message)


def cancel_input(context: SessionContext, state: State) -> State:
    """Drop the unfinished brush, the pending operator and an error message."""
    if state.brush is None and state.operator == "replace" and not state.is_error:
        return state
    return state.updated(brush=None, operator="replace")
