"""The geo-map: where the instances stand, and the heat on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from s2rtui.analysis.identity_cache import identity
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush_surface import Mark, Panel, Point
from s2rtui.charts.adjust.adjusted_instance import live_poses
from s2rtui.charts.map import terminal
from s2rtui.charts.shared import inputs, view_inputs
from s2rtui.charts.view import Pane, Pixels, Scene, Table, View, area
from s2rtui.session import Session
from s2rtui.session.heatmaps import sample_note

_TITLES = {
    "colour": "distance between the sim and the real prediction",
    "glyph": "direction and size of the errors",
    "full": "predicted and true positions",
}
_TOLD = {
    "colour": "truth coloured by shift",
    "glyph": "direction and size of both errors",
    "full": "sim, truth, real",
}


class MapView(View):
    name = "map"
    key = "2"
    pane: Pane = "centre"
    description = "geo-map: truth, predictions and heat on the floor plan"
    aliases = ("geomap",)
    feeds = ("floor plan", "heat on the map", "what was seen")
    paper = (1600, 1200)

    def told(self, scene: Scene) -> str:
        state, told = scene.state, _TOLD[scene.state.map_mode]
        if state.clip:
            saw = f"what the selection saw{sample_note(state)}"
            failed = scene.resources.failed.get("what was seen")
            if scene.resources.seen_on_map(state) is not None:
                told += f", {saw}"
            else:
                told += f", {saw} is not known: {failed}" if failed else f", loading {saw}"
        lacks = (
            feed for feed in ("floor plan", "heat on the map") if feed in scene.resources.failed
        )
        return told + "".join(f", no {feed}: {scene.resources.failed[feed]}" for feed in lacks)

    def input(self, scene: Scene) -> inputs.GeoMapInput:
        state, resources = scene.state, scene.resources
        view = view_inputs.map_input(
            scene.store,
            state,
            resources.floor_plan,
            resources.heat_on_map(state),
            resources.seen_on_map(state),
            scene.mark(self.name),
            resources.heat_note(state),
        )
        shown = resources.adjusted(state) if state.adjusting else None
        if shown is None or shown.iid != state.cursor:
            return view
        return replace(view, live=live_poses(shown))

    def depends(self, scene: Scene) -> tuple[object, ...]:
        return identity(self.input(scene)), scene.state.viewport

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        return terminal.geomap(self.input(scene), size, look, scene.state.viewport)

    def numbers(self, scene: Scene) -> Table:
        truth, run = scene.store.instances, scene.store.run_columns(scene.state.run)
        columns = (truth.x, truth.y, np.degrees(truth.heading), run.sim.x, run.sim.y,
                   np.degrees(run.sim.heading), run.real.x, run.real.y,
                   np.degrees(run.real.heading), run.shift)  # fmt: skip
        names = ("iid", "x", "y", "heading", "sim x", "sim y", "sim heading", "real x", "real y",
                 "real heading", "shift")  # fmt: skip
        chosen = np.flatnonzero(scene.state.selected)
        picked = [column[chosen].tolist() for column in columns]
        return names, list(zip(chosen.tolist(), *picked, strict=True))

    def words(self, scene: Scene) -> str:
        state, truth = scene.state, scene.store.instances
        shift = scene.store.run_columns(state.run).shift[state.selected]
        shift = shift[np.isfinite(shift)]
        codes = truth.room[state.selected]
        counts = [(int((codes == code).sum()), name) for code, name in enumerate(truth.room_names)]
        rooms = ", ".join(f"{name} {n}" for n, name in sorted(counts, key=lambda r: -r[0]) if n)
        told = f"Map of run {state.run}: {state.count} instances; {rooms or 'in no room'}."
        if shift.size:
            told += (
                f" Sim and real predictions lie {np.median(shift):.2f} m apart in the median, "
                f"{shift.max():.2f} m at most."
            )
        return told

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.map import paper

        view, state = self.input(scene), scene.state
        title = f"{state.run}: {_TITLES[state.map_mode]}"
        title += f"; heat: {view.heat_label}" if view.heat is not None else ""
        return paper.geomap_figure(
            view, size, theme, state.run, scene.caption, title, state.viewport
        )

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        return terminal.geomap_surface(self.input(scene), size, look, scene.state.viewport)

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        return view_inputs.point_of(view_inputs.truth_points(scene.store), scene.state.cursor)

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        points = view_inputs.truth_points(scene.store)
        nearest = view_inputs.nearest(points, scene.state.base, point)
        if nearest is not None:
            session.set_cursor(nearest)

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        return area(panel, mark, "box", "lasso")
