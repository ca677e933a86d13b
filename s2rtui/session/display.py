"""What is shown and how: heat, map and views. Each function changes the session's state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from s2rstore.records import Side
from s2rtui.analysis.map_frame import centred_within, panned, zoomed
from s2rtui.session.heatmaps import choices, share_told
from s2rtui.session.run_differences import other_run
from s2rtui.session.session import Session
from s2rtui.session.state import AGGREGATES, MAP_MODES, OVERLAYS, State

CLOSEST = 1 / 200
"""Of the map's size: what the closest view shows."""
T = TypeVar("T")


def _after(options: Sequence[T], present: T, steps: int = 1) -> T:
    return options[(options.index(present) + steps) % len(options)]


def change_heat(session: Session, steps: int) -> State:
    """The next heatmap kind."""
    return _change_heat(session, steps, same_kind=False)


def change_mode(session: Session) -> State:
    """The next mode of the same kind."""
    return _change_heat(session, 1, same_kind=True)


def _change_heat(session: Session, steps: int, same_kind: bool) -> State:
    state, heat = session.state, session.state.heat
    options = choices(session.store, state.run)
    if heat is None or not options:
        return session.tell(f"run {state.run} has no heatmaps; `s2r precompute` makes them")
    if same_kind:
        modes = [mode for kind, mode in options if kind == heat.kind]
        made = replace(heat, mode=_after(modes, heat.mode))
    else:
        kind = _after(list(dict.fromkeys(kind for kind, _ in options)), heat.kind, steps)
        made = replace(heat, kind=kind, mode=next(m for k, m in options if k == kind))
    return session.change(heat=made, message=made.label)


def change_side(session: Session) -> State:
    """The side that one-sided views and the map's heat show."""
    if session.state.heat is None:
        return session.tell("no heatmaps")
    side: Side = "sim" if session.state.heat.side == "real" else "real"
    heat = replace(session.state.heat, side=side)
    return session.change(heat=heat, message=f"heat of the {side} side")


def change_overlay(session: Session) -> State:
    """No heat on the map, that of the instance, of the selection, of the whole run."""
    if session.state.heat is None:
        return session.tell("no heatmaps")
    overlay = _after(OVERLAYS, session.state.overlay)
    told = {
        "off": "heat off",
        "instance": "heat of this instance",
        "selection": f"heat of the selection ({session.state.aggregate})"
        + share_told(session.state),
        "run": f"heat of the whole run ({session.state.aggregate})",
    }
    return session.change(overlay=overlay, message=told[overlay])


def change_aggregate(session: Session) -> State:
    """How heat is gathered per cell of the map."""
    aggregate = _after(AGGREGATES, session.state.aggregate)
    return session.change(aggregate=aggregate, message=f"heat: {aggregate}")


def change_map_mode(session: Session) -> State:
    mode = _after(MAP_MODES, session.state.map_mode)
    told = {
        "colour": "truth coloured by the shift",
        "glyph": "direction and size of both errors",
        "full": "sim, truth and real",
    }
    return session.change(map_mode=mode, message=f"map: {told[mode]}")


def toggle_clip(session: Session) -> State:
    """Dim what no selected instance has seen."""
    clip = not session.state.clip
    told = "only what the selection has seen" if clip else "the whole map"
    return session.change(clip=clip, message=told)


def toggle_room_names(session: Session) -> State:
    return session.change(room_names=not session.state.room_names)


def zoom(session: Session, factor: float, at: tuple[float, float] | None = None) -> State:
    """Around a point in metres, by default the cursor; 0, or far enough out, shows the whole map.

    The closest view is `CLOSEST` of the map.
    """
    state, bounds = session.state, session.store.dataset.bounds
    if factor == 0:
        return session.change(viewport=None)
    view = state.viewport or bounds
    truth, cursor = session.store.instances, state.cursor
    if at is None and cursor is not None:
        at = float(truth.x[cursor]), float(truth.y[cursor])
    share = max(view.width / max(bounds.width, 1e-9), view.height / max(bounds.height, 1e-9))
    factor = min(factor, share / CLOSEST)
    if share / factor >= 1:
        return session.change(viewport=None)
    return session.change(viewport=centred_within(zoomed(view, factor, at), bounds))


def pan(session: Session, across: float, down: float) -> State:
    """By shares of what is in view; its middle stays on the map."""
    bounds = session.store.dataset.bounds
    view = session.state.viewport or bounds
    moved = panned(view, across, down, session.store.dataset.y_down)
    return session.change(viewport=centred_within(moved, bounds))


def change_other(session: Session, steps: int = 1) -> State:
    """The run that is compared with."""
    others = [name for name in session.state.runs if name != session.state.run]
    if not others:
        return session.tell("there is only one run to look at")
    present = other_run(session.state)
    other = others[0] if present is None else _after(others, present, steps)
    return session.change(other=other, message=f"compared with {other}")


def show_view(session: Session, name: str, pane: str) -> State:
    """Make a view of a pane the one that keys speak to, and see it."""
    state = session.state
    centre = name if pane == "centre" else state.centre
    tab = name if pane == "tab" else state.tab
    return session.change(view=name, centre=centre, tab=tab, brush=None)


def activate(session: Session, name: str) -> State:
    """Make a view that is on the screen the one that keys speak to; all stays in its place."""
    if session.state.view == name:
        return session.state
    return session.change(view=name, brush=None)


def leave(session: Session) -> State:
    """Without a brush, a pending operator, an error."""
    state = session.state
    if state.brush is None and state.operator == "replace" and not state.is_error:
        return state
    return session.change(brush=None, operator="replace")
