"""Sim error against real error: which instances are poor in sim and good in reality."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas, Mark, Panel, Point, RenderOptions, Size, Theme
from s2rtui.charts.scatter.axis import WHOLE, ErrorAxis
from s2rtui.charts.scatter.brush import box_expression, lasso_expression
from s2rtui.charts.scatter.model import PERCENT, QUADRANTS, ScatterInput, scatter_summary
from s2rtui.charts.scatter.terminal import draw_scatter, scatter_panels
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.points import known_point, nearest_iid, stacked_points
from s2rtui.charts.view import Pixels, PointsView, Table
from s2rtui.drawing.scale import Floats
from s2rtui.session.counted_values import counted_values
from s2rtui.session.view_settings import ZoomPlane


class ScatterView(PointsView):
    name = "scatter"
    key = "X"
    description = "sim error against real error of each instance"
    narrow_ratio = 2.15
    wide_ratio = 0.8
    figure_size = (1500, 1200)

    def subtitle(self, scene: Scene) -> str:
        summary = scatter_summary(self.input(scene))
        return f"{QUADRANTS[0].name}: {summary.quadrants[0][0]} of {summary.total}"

    def input(self, scene: Scene) -> ScatterInput:
        state = scene.state
        columns = scene.store.run_columns(state.run)
        sim, real = (
            counted_values(state.population, columns, side.error)
            for side in (columns.sim, columns.real)
        )
        return ScatterInput(
            sim, real, state.selected, state.base, cursor=state.cursor,
            mark=scene.mark(self.name), trained=state.marked,
            viewport=state.viewport_of(self.name),
        )  # fmt: skip

    def numbers(self, scene: Scene) -> Table:
        """Instances and selected ones per quadrant, and by which error is larger."""
        view = self.input(scene)
        summary = scatter_summary(view)
        rows: list[tuple[object, ...]] = [
            (quadrant.name, total, selected, quadrant.expression)
            for quadrant, (total, selected) in zip(QUADRANTS, summary.quadrants, strict=True)
        ]
        real_larger, sim_larger = (
            int(np.count_nonzero(larger & view.valid))
            for larger in (view.real > view.sim, view.sim > view.real)
        )
        rows.append(("real error larger", real_larger, summary.real_larger, "gap > 0"))
        rows.append(("sim error larger", sim_larger, summary.sim_larger, "gap < 0"))
        rows.append(("all", summary.total, summary.selected, "all"))
        return ("quadrant", "instances", "selected", "expression"), rows

    def summary(self, scene: Scene) -> str:
        summary = scatter_summary(self.input(scene))
        (poor_sim, _), (poor_real, _) = summary.quadrants[:2]
        return (
            f"Of {summary.total} instances, {poor_sim} are among the worst {PERCENT} % in sim and "
            f"the best {PERCENT} % in real, {poor_real} among the best {PERCENT} % in sim and the "
            f"worst {PERCENT} % in real. Of {summary.selected} selected, the real error is larger "
            f"on {summary.real_larger} and the sim error on {summary.sim_larger}."
        )

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_scatter(self.input(scene), size, options)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        return scatter_panels(self.input(scene), size, options)

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.scatter import paper

        title = f"{scene.state.run}: error in simulation against error in reality"
        return paper.scatter_figure(self.input(scene), size, theme, title, scene.caption)

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        """Fractions of both axes, because these may be logarithmic."""
        view, cursor = self.input(scene), scene.state.cursor
        places = _drawn_places(view.sim, view.real, view.axis)
        return ZoomPlane(self.name, WHOLE, False, known_point(places, cursor))

    def plane_point(self, scene: Scene, point: Point) -> Point:
        across, up = (float(self.input(scene).axis.drawn(error)) for error in point)
        return across, up

    def points(self, scene: Scene, panel: Panel) -> Floats:
        view = self.input(scene)
        sim, real = (np.asarray(errors, dtype=np.float64) for errors in (view.sim, view.real))
        return stacked_points(sim, real)

    def nearest(self, scene: Scene, panel: Panel, point: Point) -> int | None:
        view = self.input(scene)
        places = _drawn_places(view.sim, view.real, view.axis)
        across, up = self.plane_point(scene, point)
        shown = view.plane.shown
        wide, high = panel.width / shown.width, 2 * panel.height / shown.height
        return nearest_iid(places * (wide, high), scene.state.base, (across * wide, up * high))

    def to_expression(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        view = self.input(scene)
        shown = view.plane.shown
        cell = shown.width / panel.width, shown.height / panel.height
        if mark.lasso:
            return lasso_expression(view.axis, mark, cell)
        return box_expression(view.axis, view.sim, view.real, mark, cell)


VIEW = ScatterView()


@cached_by_identity(2)
def _drawn_places(sim: Floats, real: Floats, axis: ErrorAxis) -> Floats:
    """(N, 2) places of the instances as fractions of the axes."""
    return np.stack([axis.drawn(sim), axis.drawn(real)], axis=1)
