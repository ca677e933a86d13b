"""The recall view: shares of instances within metres and degrees, as curves and at thresholds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.intervals import Interval
from s2rstore.metrics import recall
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.analysis.binning import Bools
from s2rtui.charts.view import StatisticsView
from s2rtui.drawing.figures import Figure, Figures
from s2rtui.drawing.plot import Dots, Line, Mark, Plot, Rule
from s2rtui.drawing.scale import Scale
from s2rtui.session.state import State

_BELOW, _BEYOND = 2.0, 8.0
"""Factors by which the axis reaches beyond the smallest and the largest threshold."""
_TICKS_BEYOND = (2.5, 5.0)
"""Multiples of the largest threshold that have a tick."""
_SHIFT, _SAMPLES = 1.012, 3000


@dataclass(frozen=True, slots=True, eq=False)
class RecallModel:
    """Figures and curves of the selection by side, and curves of all where these are more.

    `lost` instances in view are not localised and cannot be in the selection.
    """

    figures: dict[Side, recall.SideRecall]
    curves: dict[Side, recall.RecallCurve]
    everything: dict[Side, recall.RecallCurve]
    lost: int = 0

    @property
    def counted(self) -> str:
        """`n 100 (sim 2, real 5 not localised)`."""
        text = f"n {self.figures['real'].n}"
        if any(each.not_localised for each in self.figures.values()):
            lost = ", ".join(f"{side} {each.not_localised}" for side, each in self.figures.items())
            return f"{text} ({lost} {recall.NOT_LOCALISED})"
        return f"{text}; {self.lost} {recall.NOT_LOCALISED} left out" if self.lost else text


class RecallView(StatisticsView):
    name = "recall"
    key = "Q"
    description = "recall: shares of instances within metres and degrees"
    about = "share of instances within both thresholds"
    title = "recall in simulation and in reality"

    def model(self, store: Store, state: State) -> RecallModel:
        run, members, population = state.run, self.members(state), state.population

        def measured(measure: Callable[..., Any], members: Bools | None) -> dict[Side, Any]:
            return {s: measure(store, run, s, members, population=population) for s in SIDES}

        everything = measured(recall.recall_curve, None)
        figures = measured(recall.side_recall, members)
        if members is None:
            return RecallModel(figures, everything, {})
        curves = measured(recall.recall_curve, members)
        columns = store.run_columns(run)
        lost = population.attempted(store.instances, columns) & ~columns.valid
        return RecallModel(figures, curves, everything, int(lost.sum()))

    def figures(self, model: RecallModel) -> Figures:
        return {side: tuple(_figures(side, found)) for side, found in model.figures.items()}

    def plots(self, model: RecallModel) -> tuple[Plot, ...]:
        return (_plot(model),)

    def notes(self, model: RecallModel) -> tuple[str, ...]:
        reasons = (p.share.no_bounds for each in model.figures.values() for p in each.points)
        return (model.counted, *list(filter(None, reasons))[:1])


def _plot(model: RecallModel) -> Plot:
    points = model.figures["real"].points
    heading = f"heading within {model.curves['real'].ratio:g} deg per m"
    ticks = [p.metres for p in points] + [points[-1].metres * each for each in _TICKS_BEYOND]
    x = Scale(
        points[0].metres / _BELOW, points[-1].metres * _BEYOND,
        (f"position within (m), {heading}", "position within (m)", "m"), log=True,
        fixed=tuple((metres, f"{metres:g}") for metres in ticks),
    )  # fmt: skip
    y = Scale(0, 100, ("recall (%)",), fixed=((0, "0 %"), (50, "50 %"), (100, "100 %")))
    metres = x.value(np.linspace(0, 1, _SAMPLES))
    whole = zip(model.everything.values(), ("all instances", ""), strict=False)
    marks: list[Mark] = [Rule(p.metres) for p in points]
    marks += [Line(metres, 100 * c.at(metres), "unselected", name) for c, name in whole]
    marks += [Line(metres, 100 * c.at(metres), side, side) for side, c in model.curves.items()]
    at = np.array([p.metres for p in points])
    for (side, each), shift in zip(model.figures.items(), (1 / _SHIFT, _SHIFT), strict=True):
        marks.append(Dots.of(at, [p.share.scaled(100) for p in each.points], side, shift=shift))
    return Plot(x, y, tuple(marks))


def _figures(side: Side, found: recall.SideRecall) -> Iterator[Figure]:
    """Recall at the thresholds, medians, skill, and the number that is not localised."""
    n, in_degrees = found.n, found.heading.scaled(180 / math.pi)
    for point in found.points:
        within = f"{side}.error <= {point.metres:g} & {side}.heading_error <= {point.degrees:g}"
        share = point.share.scaled(100)
        yield Figure("recall", share, "%", 0, point.name, n, expression=within)
    yield Figure("median position", found.position, "m", n=n, text=found.position_text)
    yield Figure("median heading", in_degrees, "deg", 1, n=n, text=found.heading_text)
    yield Figure("skill", found.skill, n=n)
    lost = Interval.unknown(float(found.not_localised))
    yield Figure(recall.NOT_LOCALISED, lost, digits=0, n=n, in_table=False)


VIEW = RecallView()
