"""The map: instances at their true positions, predictions and heat on the floor plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES, Side
from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import Canvas, PlotArea, RenderOptions, Size, Theme
from s2rtui.charts.map import terminal
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.base_map_model import LivePose, MapInput, map_input
from s2rtui.charts.shared.instance import InstanceInput, SideView
from s2rtui.charts.view import Pane, Pixels, PointsView, Table
from s2rtui.session import map_values
from s2rtui.session.heatmaps import sample_note, trust_text
from s2rtui.session.view_settings import ZoomPlane, map_plane

_TITLES = {
    "glyph": "direction and size of the errors",
    "full": "predicted and true positions",
}
_SUBTITLES = {
    "glyph": "direction and size of both errors",
    "full": "predictions in sim and real, joined to the truth",
}


_FRAME_COLUMNS, _FRAME_ROWS = 4, 3
"""Columns and rows of the axes and the legend."""
_POSE = ("x_m", "y_m", "heading_deg")


class MapView(PointsView):
    name = "map"
    needs_run = False
    key = "2"
    pane: Pane = "centre"
    description = "map: truth, predictions and heat on the floor plan"
    narrow_ratio = 1.8
    wide_ratio = 0.9
    aliases = ("geomap",)
    loads = ("floor plan", "heat on the map", "seen floor")
    figure_size = (1600, 1200)

    def subtitle(self, scene: Scene) -> str:
        state = scene.state
        value = map_values.shown(scene.store, state.run, state.map_value)
        by_mode = {"colour": f"truth, coloured by {value.short or value.phrase}"} | _SUBTITLES
        text = by_mode[state.map_mode]
        if scene.store.missing_run:
            text = "true positions"
        if state.dims_unseen_floor:
            seen = f"what the selection saw{sample_note(state)}"
            failed = scene.loaded.failed.get("seen floor")
            if scene.loaded.seen_on_map(state) is not None:
                text += f", {seen}"
            else:
                text += f", {seen} is unknown: {failed}" if failed else f", loading {seen}"
        failed_loads = scene.loaded.failed
        missing = (name for name in ("floor plan", "heat on the map") if name in failed_loads)
        return text + "".join(f", no {name}: {failed_loads[name]}" for name in missing)

    def input(self, scene: Scene) -> MapInput:
        state, resources = scene.state, scene.loaded
        view = map_input(
            scene.store,
            state,
            resources.floor_plan,
            resources.heat_on_map(state),
            resources.seen_on_map(state),
            scene.mark(self.name),
            resources.heat_note(state),
        )
        adjusted = resources.adjusted(state) if state.adjusting else None
        if adjusted is None or adjusted.iid != state.cursor:
            return view
        return replace(view, live=_live_poses(adjusted))

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        return identity_key(self.input(scene)), scene.state.viewport

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return terminal.draw_map(self.input(scene), size, options, scene.state.viewport)

    def numbers(self, scene: Scene) -> Table:
        truth, run = scene.store.instances, scene.store.run_columns(scene.state.run)
        columns: tuple[NDArray[Any], ...] = (
            truth.x,
            truth.y,
            np.degrees(truth.heading),
            run.sim.x,
            run.sim.y,
            np.degrees(run.sim.heading),
            run.real.x,
            run.real.y,
            np.degrees(run.real.heading),
            run.shift,
        )
        names: tuple[str, ...] = (
            "iid",
            *_POSE,
            *(f"sim_{name}" for name in _POSE),
            *(f"real_{name}" for name in _POSE),
            "shift_m",
        )
        record = scene.store.displayed_run(scene.state.run)
        for side in SIDES:
            if (domain := record.domain(side)) in scene.store.domains_with_own_poses:
                x, y, heading = scene.store.poses(domain).T
                columns += (x, y, np.degrees(heading))
                names += tuple(f"{side}_true_{name}" for name in _POSE)
        selection = np.flatnonzero(scene.state.selected)
        picked = [column[selection].tolist() for column in columns]
        if scene.state.marked is not None:
            names, picked = (*names, "split"), [*picked, scene.splits(selection)]
        return names, list(zip(selection.tolist(), *picked, strict=True))

    def summary(self, scene: Scene) -> str:
        state, truth = scene.state, scene.store.instances
        shift = scene.store.run_columns(state.run).shift[state.selected]
        shift = shift[np.isfinite(shift)]
        codes = truth.room[state.selected]
        counts = [(int((codes == code).sum()), name) for code, name in enumerate(truth.room_names)]
        rooms = ", ".join(f"{name} {n}" for n, name in sorted(counts, key=lambda r: -r[0]) if n)
        of_run = f"Map of run {state.run}" if state.run else "Map of the true positions"
        text = f"{of_run}: {state.count_text} instances; {rooms or 'in no room'}."
        if shift.size:
            text += (
                f" Sim and real predictions lie {np.median(shift):.2f} m apart in the median, "
                f"{shift.max():.2f} m at most."
            )
        return text

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.map import paper

        view, state = self.input(scene), scene.state
        phrase = map_values.shown(scene.store, state.run, state.map_value).phrase
        shown = _TITLES.get(state.map_mode, phrase) if state.run else "true positions"
        title = f"{scene.title}: {shown}"
        title += f"; heat: {view.heat_label}" if view.heat is not None else ""
        caption = scene.caption
        if view.heat is not None and (trust := trust_text(scene.store, state)):
            caption += f"  ·  heat: {trust}"
        return paper.map_figure(view, size, theme, title, caption, state.viewport)

    def height(self, scene: Scene, width: int) -> int:
        """The rows in which the whole map fills the width."""
        bounds = scene.store.dataset.bounds
        if not (bounds.width > 0 and bounds.height > 0):
            return 0
        chart = max(1, width - _FRAME_COLUMNS)
        return math.ceil(chart * bounds.height / bounds.width / 2) + _FRAME_ROWS

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        return map_plane(scene.store, scene.state)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[PlotArea]:
        return terminal.map_panels(self.input(scene), size, options, scene.state.viewport)


VIEW = MapView()


def _live_poses(instance: InstanceInput) -> tuple[LivePose, ...]:
    """The predicted poses of an instance that is being adjusted."""
    sides: tuple[tuple[Side, SideView], ...] = (("sim", instance.sim), ("real", instance.real))
    return tuple(
        LivePose(name, side.pose.x, side.pose.y, side.pose.heading)
        for name, side in sides
        if side.pose is not None
    )
