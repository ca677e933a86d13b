"""The scatter view: sim error against real error, and who is poor in one and good in the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from s2rstore.records import Bounds
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.charts.scatter.brush import box_expression, lasso_expression
from s2rtui.charts.scatter.model import (
    LOG_RULE,
    PERCENT,
    QUADRANTS,
    Limits,
    ScatterSummary,
    drawn_errors,
    error_scale,
    larger_side,
    scatter_summary,
)
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.positions import (
    cursor_phrases,
    known_point,
    nearest_iid,
    stacked_points,
    valid_cursor,
)
from s2rtui.charts.view import PointsView, Table
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Line, Phrase, Plot, Points, Rule
from s2rtui.drawing.plot import Mark as PlotMark
from s2rtui.drawing.scale import Floats, Scale, short_number
from s2rtui.session.population_values import population_values
from s2rtui.session.view_settings import ZoomPlane

PANEL = "errors"
WHOLE = Bounds(0.0, 0.0, 1.0, 1.0)
"""All of the plane, as fractions of its axes."""
_SAMPLES = 200
"""Points of the diagonal, which is a curve between the ends of logarithmic axes."""


def scatter_drawing(
    sim: Floats, real: Floats, selected: Bools, valid: Bools, shown: Bounds = WHOLE,
    cursor: int | None = None, trained: Bools | None = None, brush: BrushShape | None = None,
) -> Drawing:  # fmt: skip
    """Errors (N,) in metres; `shown`: the part of the plane in view, in fractions of its axes."""
    scale, summary = error_scale(sim, real), scatter_summary(sim, real, selected, valid)
    x = _part(scale, shown.x0, shown.x1, "sim")
    y = _part(scale, shown.y0, shown.y1, "real")
    ends = scale.value(np.linspace(0, 1, _SAMPLES))
    marks: list[PlotMark] = [Line(ends, ends, "both")]
    marks += [
        Rule(max(limit, scale.low), axis, "faint")
        for limits, part, axis in _sides(summary, x, y)
        for limit in (limits.best, limits.worst)
        if np.isfinite(limit) and 0 <= float(part.fraction(max(limit, scale.low))) < 1
    ]
    marks.append(Points(
        drawn_errors(sim, scale), drawn_errors(real, scale), larger_side(sim, real), selected,
        valid, ("sim", "both", "real"), trained, cursor,
    ))  # fmt: skip
    plot = Plot(x, y, tuple(marks), PANEL, shape="plane")
    return Drawing(
        (plot,), notes=((*_notes(summary, scale), *cursor_phrases(cursor)),), brush=brush
    )


def _sides(
    summary: ScatterSummary, x: Scale, y: Scale
) -> tuple[tuple[Limits, Scale, Literal["x", "y"]], ...]:
    return (summary.sim, x, "x"), (summary.real, y, "y")


def _part(scale: Scale, first: float, last: float, side: str) -> Scale:
    """The part of an axis between two fractions of it."""
    names = f"{side} error (m){', log' if scale.log else ''}", f"{side} error (m)", "m"
    if (first, last) == (0.0, 1.0):
        return replace(scale, names=names)
    low, high = scale.value([first, last])
    return replace(scale, low=float(low), high=float(high), names=names)


def _notes(summary: ScatterSummary, scale: Scale) -> list[Phrase]:
    """What colours and lines mean, with the counts of the quadrants."""
    phrases = [
        Phrase(f"real error larger (above the diagonal): {summary.real_larger}", "real", "real"),
        Phrase(f"sim error larger: {summary.sim_larger}", "sim", "sim"),
    ]
    if scale.log:
        below = f"; {summary.below} below {short_number(scale.low)} m at the edge"
        phrases.append(Phrase(f"log axes: {LOG_RULE}{below if summary.below else ''}"))
    phrases.append(Phrase("diagonal: sim = real", "both"))
    limits = "".join(
        f", {side} to {short_number(each.best, 2)} and from {short_number(each.worst, 2)} m"
        for side, each in (("sim", summary.sim), ("real", summary.real))
        if np.isfinite([each.best, each.worst]).all()
    )
    phrases.append(Phrase(f"lines: best and worst {PERCENT} % of {summary.total}{limits}"))
    return phrases + [
        Phrase(f"{quadrant.name}: {total}")
        for quadrant, (total, _) in zip(QUADRANTS[:2], summary.quadrants, strict=False)
    ]


class ScatterView(PointsView):
    name = "scatter"
    key = "X"
    description = "sim error against real error of each instance"
    title = "error in simulation against error in reality"
    figure_size = (1500, 1200)

    def subtitle(self, scene: Scene) -> str:
        summary = scatter_summary(*self.input(scene))
        return f"{QUADRANTS[0].name}: {summary.quadrants[0][0]} of {summary.total}"

    def input(self, scene: Scene) -> tuple[Floats, Floats, Bools, Bools]:
        """Position errors (N,) of both sides in metres, and the selected and valid instances."""
        state = scene.state
        columns = scene.store.run_columns(state.run)
        sim, real = (
            population_values(state.population, columns, side.error)
            for side in (columns.sim, columns.real)
        )
        return sim, real, state.selected, state.base

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        state = scene.state
        shown = state.viewport_of(self.name) or WHOLE
        cursor = valid_cursor(state.cursor, state.base)
        brush = scene.mark(self.name)
        return scatter_drawing(*self.input(scene), shown, cursor, state.marked, brush)

    def numbers(self, scene: Scene) -> Table:
        """Instances and selected ones per quadrant, and by which error is larger."""
        sim, real, selected, valid = self.input(scene)
        summary = scatter_summary(sim, real, selected, valid)
        rows: list[tuple[object, ...]] = [
            (quadrant.name, total, chosen, quadrant.expression)
            for quadrant, (total, chosen) in zip(QUADRANTS, summary.quadrants, strict=True)
        ]
        real_larger, sim_larger = (
            int(np.count_nonzero(larger & valid)) for larger in (real > sim, sim > real)
        )
        rows.append(("real error larger", real_larger, summary.real_larger, "gap > 0"))
        rows.append(("sim error larger", sim_larger, summary.sim_larger, "gap < 0"))
        rows.append(("all", summary.total, summary.selected, "all"))
        return ("quadrant", "instances", "selected", "expression"), rows

    def summary(self, scene: Scene) -> str:
        summary = scatter_summary(*self.input(scene))
        (poor_sim, _), (poor_real, _) = summary.quadrants[:2]
        return (
            f"Of {summary.total} instances, {poor_sim} are among the worst {PERCENT} % in sim and "
            f"the best {PERCENT} % in real, {poor_real} among the best {PERCENT} % in sim and the "
            f"worst {PERCENT} % in real. Of {summary.selected} selected, the real error is larger "
            f"on {summary.real_larger} and the sim error on {summary.sim_larger}."
        )

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        """Fractions of both axes, because these may be logarithmic."""
        places = _places(*self.input(scene)[:2])
        return ZoomPlane(self.name, WHOLE, False, known_point(places, scene.state.cursor))

    def plane_point(self, scene: Scene, point: Point) -> Point:
        scale = error_scale(*self.input(scene)[:2])
        across, up = scale.fraction(np.clip(point, scale.low, scale.high)).tolist()
        return across, up

    def points(self, scene: Scene, panel: PlotArea) -> Floats:
        sim, real = self.input(scene)[:2]
        scale = error_scale(sim, real)
        return stacked_points(drawn_errors(sim, scale), drawn_errors(real, scale))

    def nearest(self, scene: Scene, panel: PlotArea, point: Point) -> int | None:
        places = _places(*self.input(scene)[:2])
        shown = scene.state.viewport_of(self.name) or WHOLE
        size = np.array([panel.width / shown.width, 2 * panel.height / shown.height])
        across, up = size * self.plane_point(scene, point)
        return nearest_iid(places * size, scene.state.base, (float(across), float(up)))

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        sim, real = self.input(scene)[:2]
        shown = scene.state.viewport_of(self.name) or WHOLE
        cell = shown.width / panel.width, shown.height / panel.height
        if mark.lasso:
            return lasso_expression(error_scale(sim, real), mark, cell)
        return box_expression(error_scale(sim, real), sim, real, mark, cell)


@cached_by_identity(2)
def _places(sim: Floats, real: Floats) -> Floats:
    """(N, 2) places of the instances as fractions of the axes."""
    scale = error_scale(sim, real)
    return np.stack([scale.fraction(drawn_errors(side, scale)) for side in (sim, real)], axis=1)


VIEW = ScatterView()
