"""The scatter view: sim error against real error, and who is poor in one and good in the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.top_k import top_k
from s2rstore.records import Bounds
from s2rtui.analysis.binning import Bins, Bools, Codes, count_selected, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.canvas.fit_text import NO_BREAK
from s2rtui.charts.mark_expressions import box_expression, lasso_expression
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.planes import (
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

PERCENT = 15
"""Share of the base population: the worst 15 % of a side are called poor, the best 15 % good."""
LOG_RATIO = 20.0
"""Axes are logarithmic where the largest error is more than this many times a side's median."""
LOG_RULE = f"the largest error is over {LOG_RATIO:g} times the median of a side"
_MARGIN = 1.03
"""Upper end of the axes over the largest error."""
Rank = Literal["best", "worst"]
SIM_LARGER, EQUAL, REAL_LARGER = 1, 2, 3
"""Levels of instances by the larger of their errors; 0 where one is unknown."""
PANEL = "errors"
WHOLE = Bounds(0.0, 0.0, 1.0, 1.0)
"""All of the plane, as fractions of its axes."""
_SAMPLES = 200
"""Points of the diagonal, which is a curve between the ends of logarithmic axes."""


@dataclass(frozen=True, slots=True)
class Quadrant:
    """Instances that are extreme on both sides: `sim` and `real` say at which end."""

    sim: Rank
    real: Rank

    @property
    def name(self) -> str:
        words = {"best": "good", "worst": "poor"}
        if self.sim == self.real:
            return f"{words[self.sim]} in both"
        return f"{words[self.sim]} in sim, {words[self.real]} in real"

    @property
    def expression(self) -> str:
        return f"{self.sim}({PERCENT}%, sim.error) & {self.real}{PERCENT}"


QUADRANTS = (
    Quadrant("worst", "best"), Quadrant("best", "worst"), Quadrant("worst", "worst"),
    Quadrant("best", "best"),
)  # fmt: skip
"""The quadrants; in the first two the sides disagree."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Errors that separate the best and the worst 15 % of a side from the others; NaN for none.

    best: the largest error of the best, worst: the smallest error of the worst.
    """

    best: float
    worst: float


@dataclass(frozen=True, slots=True)
class ScatterSummary:
    """Counts of instances: `total` in view, `selected` of them.

    sim_larger, real_larger: selected instances by side of the diagonal. quadrants: per entry of
    `QUADRANTS` the instances in view and the selected ones. below: instances in view with an error
    below the axis. sim, real: limits of each side.
    """

    total: int
    selected: int
    sim_larger: int
    real_larger: int
    quadrants: tuple[tuple[int, int], ...]
    below: int
    sim: Limits
    real: Limits


def scatter_summary(sim: Floats, real: Floats, selected: Bools, valid: Bools) -> ScatterSummary:
    """Count the instances (N,) by side of the diagonal and by quadrant; errors in metres."""
    selection = selection_indices(selected, valid)
    sides, _ = count_selected(Bins(larger_side(sim, real), 4), selection)
    quadrants = [count_selected(mark, selection) for mark in _quadrant_marks(sim, real, valid)]
    scale = error_scale(sim, real)
    return ScatterSummary(
        total=int(np.count_nonzero(valid)),
        selected=int(sides[1:].sum()),
        sim_larger=int(sides[SIM_LARGER]),
        real_larger=int(sides[REAL_LARGER]),
        quadrants=tuple((int(total[0]), int(chosen[0])) for chosen, total in quadrants),
        below=_number_below(sim, real, valid, scale.low) if scale.log else 0,
        sim=_limits(sim, valid),
        real=_limits(real, valid),
    )


@cached_by_identity(8)
def error_scale(sim: Floats, real: Floats) -> Scale:
    """The axis in metres that holds every known error of both sides (N,).

    Linear from 0, or logarithmic by `LOG_RATIO`; then its lower end is the 1st percentile of the
    errors above 0, rounded down to 1, 2 or 5 times 10^n, where smaller errors are drawn.
    """
    sides = [errors[np.isfinite(errors)] for errors in (sim, real)]
    above = np.concatenate([errors[errors > 0] for errors in sides])
    if not above.size:
        return Scale(0.0, 1.0)
    high = float(above.max()) * _MARGIN
    if above.max() <= LOG_RATIO * min(np.median(errors) for errors in sides if errors.size):
        return Scale(0.0, high)
    return Scale(_rounded_down(float(np.percentile(above, 1))), high, log=True)


def _rounded_down(value: float) -> float:
    """The largest 1, 2 or 5 times 10^n that is not above `value` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(factor * power for factor in (1, 2, 5) if factor * power <= value * (1 + 1e-9))


@cached_by_identity(8)
def drawn_errors(errors: Floats, scale: Scale) -> NDArray[np.float64]:
    """The errors (N,) as they are drawn: those beyond the axis at its end; NaN stays NaN."""
    return np.clip(np.asarray(errors, dtype=np.float64), scale.low, scale.high)


@cached_by_identity(8)
def larger_side(sim: Floats, real: Floats) -> Codes:
    """Which error (N,) is larger: `SIM_LARGER`, `EQUAL` or `REAL_LARGER`; 0 where unknown."""
    sign = np.sign(np.asarray(real, dtype=np.float64) - sim) + EQUAL
    return np.nan_to_num(sign, nan=0.0).astype(np.uint16)


@cached_by_identity(16)
def extreme(errors: Floats, valid: Bools, rank: Rank) -> Bools:
    """The best or worst 15 % of the valid instances (N,), as the selection language counts them."""
    count = math.ceil(PERCENT * int(np.count_nonzero(valid)) / 100)
    return top_k(np.asarray(errors, dtype=np.float64), valid, count, rank == "worst")


@cached_by_identity(8)
def _limits(errors: Floats, valid: Bools) -> Limits:
    best, worst = (errors[extreme(errors, valid, rank)] for rank in ("best", "worst"))
    return Limits(
        float(best.max()) if best.size else math.nan,
        float(worst.min()) if worst.size else math.nan,
    )


@cached_by_identity(4)
def _quadrant_marks(sim: Floats, real: Floats, valid: Bools) -> tuple[Bins, ...]:
    """One bin for each of `QUADRANTS`: the instances that belong to it."""
    masks = (
        extreme(sim, valid, quadrant.sim) & extreme(real, valid, quadrant.real)
        for quadrant in QUADRANTS
    )
    return tuple(Bins(np.where(mask, 0, 1).astype(np.uint16), 1) for mask in masks)


@cached_by_identity(8)
def _number_below(sim: Floats, real: Floats, valid: Bools, low: float) -> int:
    return int(np.count_nonzero(((sim < low) | (real < low)) & valid))


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
    names = f"{side} error (m){', log' if scale.log else ''}", f"{side} error (m)", f"{side} m"
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
        below = f"; {summary.below} below {_metres(scale.low)} at the edge"
        phrases.append(Phrase(f"log axes: {LOG_RULE}{below if summary.below else ''}"))
    phrases.append(Phrase("diagonal: sim = real", "both"))
    limits = "".join(
        f", {side} to {_metres(each.best)} and from {_metres(each.worst)}"
        for side, each in (("sim", summary.sim), ("real", summary.real))
        if np.isfinite([each.best, each.worst]).all()
    )
    phrases.append(Phrase(f"lines: best and worst {PERCENT} % of {summary.total}{limits}"))
    return phrases + [
        Phrase(f"{quadrant.name}: {total}")
        for quadrant, (total, _) in zip(QUADRANTS[:2], summary.quadrants, strict=False)
    ]


def _metres(value: float) -> str:
    return f"{short_number(value, 2)}{NO_BREAK}m"


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
