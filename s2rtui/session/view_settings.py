"""Reducers of the display: heatmaps, map and views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from s2rstore.files.planned_poses import PlannedPose
from s2rstore.heatmap_kinds import NO_HEAT
from s2rstore.metrics import heatmap_scores
from s2rstore.reader import Store
from s2rstore.records import Bounds, Side
from s2rtui.analysis.map_frame import centred_within, panned, zoomed
from s2rtui.canvas.marks import PlotArea, Point
from s2rtui.session import brush_geometry, map_values
from s2rtui.session.context import SessionContext
from s2rtui.session.heatmaps import heatmap_choices, sample_note
from s2rtui.session.run_comparison import other_run
from s2rtui.session.state import AGGREGATES, MAP_MODES, MAP_PLANE, OVERLAYS, Brush, State

CLOSEST = 1 / 200
"""Smallest share of the map that zooming in shows."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ZoomPlane:
    """A plane that views show and that can be zoomed.

    `whole` is its rectangle, `y_down` whether y grows downwards on the screen, `centre` the point
    to zoom at, by default the middle of the viewport. Viewports have their middle on the plane;
    `inside`: they lie on it as a whole.
    """

    name: str
    whole: Bounds
    y_down: bool
    centre: Point | None = None
    inside: bool = False

    def limited(self, view: Bounds) -> Bounds:
        """A viewport moved onto the plane."""
        if not self.inside:
            return centred_within(view, self.whole)
        half_wide, half_high = view.width / 2, view.height / 2
        x0, y0, x1, y1 = self.whole.x0, self.whole.y0, self.whole.x1, self.whole.y1
        middles = Bounds(x0 + half_wide, y0 + half_high, x1 - half_wide, y1 - half_high)
        return centred_within(view, middles)


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
        "colour": f"truth coloured by {state.map_value}",
        "glyph": "direction and size of both errors",
        "full": "sim, truth and real",
    }
    return state.updated(map_mode=mode, message=f"map: {messages[mode]}")


def change_map_value(context: SessionContext, state: State) -> State:
    """Colour the map by the next value of the run."""
    names = map_values.available(context.store, state.run)
    value = _next(names, state.map_value if state.map_value in names else names[-1])
    phrase = map_values.MAP_VALUES[value].phrase
    return state.updated(map_value=value, map_mode="colour", message=f"map: {phrase}, m")


def toggle_clip(context: SessionContext, state: State) -> State:
    """Dim the floor that no selected instance has seen, or show all of it."""
    dimmed = not state.dims_unseen_floor
    message = "only the floor seen in the selection" if dimmed else "the whole map"
    return state.updated(dims_unseen_floor=dimmed, message=message)


def toggle_room_names(context: SessionContext, state: State) -> State:
    return state.updated(room_names=not state.room_names)


def map_plane(store: Store, state: State) -> ZoomPlane:
    """The plane of positions, around the cursor."""
    truth, dataset, at = store.instances, store.dataset, None
    if state.cursor is not None:
        at = float(truth.x[state.cursor]), float(truth.y[state.cursor])
        if not np.isfinite(at).all():
            at = None
    return ZoomPlane(MAP_PLANE, dataset.bounds, dataset.y_down, at)


def zoom(
    context: SessionContext, state: State, plane: ZoomPlane, factor: float, at: Point | None = None
) -> State:
    """Zoom a plane by a factor around a point, by default its `centre`.

    Factor 0, or zooming out far enough, shows the whole plane.
    """
    whole, shown = plane.whole, state.viewport_of(plane.name)
    view = shown or whole
    share = max(view.width / max(whole.width, 1e-9), view.height / max(whole.height, 1e-9))
    factor = min(factor, share / CLOSEST)
    if factor == 0 or share / factor >= 1:
        return _with_viewport(state, plane, None)
    view = plane.limited(zoomed(view, factor, at or plane.centre))
    return _with_viewport(state, plane, view)


def pan(
    context: SessionContext, state: State, plane: ZoomPlane, across: float, down: float
) -> State:
    """Move the viewport of a plane by shares of its size; its centre stays on the plane."""
    view = state.viewport_of(plane.name) or plane.whole
    moved = panned(view, across, down, plane.y_down)
    return _with_viewport(state, plane, plane.limited(moved))


def _with_viewport(state: State, plane: ZoomPlane, view: Bounds | None) -> State:
    viewports = {name: bounds for name, bounds in state.viewports if name != plane.name}
    if view is None:
        return state.updated(viewports=tuple(viewports.items()))
    times = max(plane.whole.width, plane.whole.height) / max(view.width, view.height, 1e-12)
    is_whole = times < 1.005
    message = "" if is_whole else f"{plane.name} enlarged {times:.3g} times (0: all of it)"
    viewports[plane.name] = view
    return state.updated(viewports=tuple(viewports.items()), message=message)


def choose_row(context: SessionContext, state: State, view: str, name: str | None) -> State:
    """Choose a row of a view's table by its name; None: that which the view chooses."""
    kept = tuple(entry for entry in state.chosen_rows if entry[0] != view)
    return state.updated(chosen_rows=kept if name is None else (*kept, (view, name)))


def set_moment(context: SessionContext, state: State, moment: float) -> State:
    """Show another moment of the drive, seconds since its start."""
    return replace(state, moment=moment)


def show_planned(
    context: SessionContext, state: State, planned: tuple[PlannedPose, ...], run: str
) -> State:
    """Show the poses of new images for a run on the map and in the view of suggestions."""
    return replace(state, planned=planned, planned_run=run)


def toggle_full_screen(context: SessionContext, state: State) -> State:
    """Fill the screen with the active view, or show all views again."""
    return state.updated(fills_screen=not state.fills_screen)


def change_other(context: SessionContext, state: State, steps: int = 1) -> State:
    """Compare with the next run."""
    others = [name for name in state.runs if name != state.run]
    if not others:
        return state.with_message("there is no other run to compare with")
    present = other_run(state)
    other = others[0] if present is None else _next(others, present, steps)
    return state.updated(compared_run=other, message=f"compared with {other}")


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


def toggle_lasso(context: SessionContext, state: State, panel: PlotArea | None = None) -> State:
    """Brush with a lasso, or with a box; a brush on a plane `panel` is converted."""
    message = "brushes draw a box" if state.lasso else "brushes draw a lasso"
    brush = state.brush
    if brush is not None and panel is not None and panel.shape == "plane":
        convert = brush_geometry.as_box if brush.mark.lasso else brush_geometry.as_lasso
        brush = convert(brush) if brush.mark.lasso == state.lasso else brush
    return state.updated(lasso=not state.lasso, brush=brush, message=message)


def cancel_input(context: SessionContext, state: State) -> State:
    """Drop the unfinished brush, the pending operator and an error message; or else the mark of a
    class of objects.
    """
    if state.brush is None and state.operator == "replace" and not state.is_error:
        return choose_row(context, state, "objects", None)
    return state.updated(brush=None, operator="replace")
