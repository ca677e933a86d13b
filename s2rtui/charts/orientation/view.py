"""The headings of the selection: predicted in sim, true, predicted in real."""

from __future__ import annotations

import math
from collections.abc import Sequence

from s2rstore.records import SIDES
from s2rtui.canvas import BrushShape, Canvas, PlotArea, Point, RenderOptions, Size, Theme
from s2rtui.charts.mark_expressions import heading_expression
from s2rtui.charts.orientation.model import OrientationInput, orientation_model
from s2rtui.charts.orientation.terminal import draw_orientation, orientation_panels
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pixels, Table, View

_FIELDS = {"sim": "sim.heading", "truth": "heading", "real": "real.heading"}


class OrientationView(View):
    name = "orientation"
    key = "5"
    description = "headings in bins of 5 degrees: sim, truth, real"
    narrow_ratio = 2.4
    figure_size = (1600, 720)

    def subtitle(self, scene: Scene) -> str:
        store, run = scene.store, scene.store.run(scene.state.run)
        own = [side for side in SIDES if run.domain(side) in store.domains_with_own_poses]
        note = f"; {' and '.join(own)} images have true headings of their own" if own else ""
        return f"headings (R: 1 = all alike){note}"

    def input(self, scene: Scene) -> OrientationInput:
        store, state = scene.store, scene.state
        columns = store.run_columns(state.run)
        return OrientationInput(
            columns.sim.heading, store.instances.heading, columns.real.heading, state.selected,
            state.base, store.dataset.y_down, state.cursor, scene.mark(self.name),
        )  # fmt: skip

    def numbers(self, scene: Scene) -> Table:
        model = orientation_model(self.input(scene))
        counts = [panel.highlighted.tolist() for panel in model.panels]
        step = 360 // len(counts[0])
        starts = [-180 + step * index for index in range(len(counts[0]))]
        rows = list(zip(starts, [s + step for s in starts], *counts, strict=True))
        return ("from_deg", "to_deg", "sim", "truth", "real"), rows

    def summary(self, scene: Scene) -> str:
        panels = orientation_model(self.input(scene)).panels
        means = [
            f"{name} {panel.mean:.0f} degrees (resultant length {panel.resultant:.2f})"
            for name, panel in zip(_FIELDS, panels, strict=True)
            if math.isfinite(panel.mean)
        ]
        return f"Mean headings: {', '.join(means) or 'none'}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.orientation import paper

        title = f"{scene.state.run}: headings in simulation, in truth and in reality"
        return paper.orientation_figure(self.input(scene), size, theme, title, scene.caption)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_orientation(self.input(scene), size, options)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[PlotArea]:
        return orientation_panels(self.input(scene), size, options)

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        if scene.state.cursor is None:
            return None
        heading = float(getattr(self.input(scene), panel.name)[scene.state.cursor])
        return (math.degrees(heading), 1.0) if math.isfinite(heading) else None

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        return heading_expression(mark, _FIELDS[panel.name])


VIEW = OrientationView()
