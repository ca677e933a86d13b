"""The recall view: shares of instances within metres and degrees, as curves and at thresholds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from s2rstore.index.population import Population
from s2rstore.intervals import Interval
from s2rstore.metrics.recall import (
    NOT_LOCALISED,
    RecallCurve,
    SideRecall,
    recall_curve,
    side_recall,
)
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import StatisticsView
from s2rtui.drawing.figures import Figure, Figures
from s2rtui.drawing.plot import Dots, Line, Mark, Plot, Rule
from s2rtui.drawing.scale import Scale
from s2rtui.session import State

_BELOW, _BEYOND = 2.0, 8.0
"""Factors by which the axis reaches beyond the smallest and the largest threshold."""
_SHIFT = 1.012
_SAMPLES = 3000


@dataclass(frozen=True, slots=True, eq=False)
class SideCurves:
    """A side of the selection: figures and curve, and the curve of all where they are not all."""

    figures: SideRecall
    curve: RecallCurve
    everything: RecallCurve | None


@dataclass(frozen=True, slots=True, eq=False)
class RecallModel:
    """Figures and curves of sim and real.

    `lost` instances in view are not localised and cannot be in the selection.
    """

    sides: dict[Side, SideCurves]
    lost: int = 0

    @property
    def counted(self) -> str:
        """`n 100 (sim 2, real 5 not localised)`."""
        lost = {side: each.figures.not_localised for side, each in self.sides.items()}
        text = f"n {self.sides['real'].figures.n}"
        if any(lost.values()):
            listed = ", ".join(f"{side} {count}" for side, count in lost.items())
            return f"{text} ({listed} {NOT_LOCALISED})"
        return f"{text}; {self.lost} {NOT_LOCALISED} left out" if self.lost else text


@cached_by_identity(8)
def recall_model(
    store: Store, run: str, selected: Bools, base: Bools, population: Population
) -> RecallModel:
    """The numbers of the selected instances.

    Where all are selected, instances that are not localised are included.
    """
    is_all = np.array_equal(selected, base)
    members = None if is_all else np.asarray(selected)
    columns = store.run_columns(run)
    lost = population.attempted(store.instances, columns) & ~columns.valid

    def curves(side: Side) -> SideCurves:
        everything = recall_curve(store, run, side, None, population)
        return SideCurves(
            side_recall(store, run, side, members, population=population),
            everything if is_all else recall_curve(store, run, side, members, population),
            None if is_all else everything,
        )

    return RecallModel({side: curves(side) for side in SIDES}, 0 if is_all else int(lost.sum()))


class RecallView(StatisticsView):
    name = "recall"
    key = "Q"
    description = "recall: shares of instances within metres and degrees"
    title = "recall in simulation and in reality"
    narrow_ratio = 1.9
    wide_ratio = 0.65

    def subtitle(self, scene: Scene) -> str:
        return "share of instances within both thresholds"

    def model(self, store: Store, state: State) -> RecallModel:
        return recall_model(store, state.run, state.selected, state.base, state.population)

    def figures(self, model: RecallModel) -> Figures:
        return {side: tuple(_figures(each.figures)) for side, each in model.sides.items()}

    def plots(self, model: RecallModel) -> tuple[Plot, ...]:
        return (_plot(model),)

    def notes(self, model: RecallModel) -> tuple[str, ...]:
        shares = (p.share for each in model.sides.values() for p in each.figures.points)
        reasons = [share.no_bounds for share in shares if share.no_bounds][:1]
        return (model.counted, *reasons)


def _plot(model: RecallModel) -> Plot:
    real = model.sides["real"]
    points = real.figures.points
    heading = f"heading within {real.curve.ratio:g} deg per m"
    x = Scale(
        points[0].metres / _BELOW, points[-1].metres * _BEYOND,
        (f"position within (m), {heading}", heading, "m"), log=True,
        fixed=tuple((p.metres, f"{p.metres:g} m") for p in points),
    )  # fmt: skip
    y = Scale(0, 100, ("recall (%)",), fixed=((0, "0 %"), (50, "50 %"), (100, "100 %")))
    metres = x.value(np.linspace(0, 1, _SAMPLES))
    marks: list[Mark] = [Rule(p.metres) for p in points]
    for each in model.sides.values():
        if each.everything is not None and each.everything.limits.size:
            marks += [Line(metres, 100 * each.everything.at(metres), "unselected")]
    for side, each in model.sides.items():
        if each.curve.limits.size:
            marks += [Line(metres, 100 * each.curve.at(metres), side)]
    for (side, each), shift in zip(model.sides.items(), (1 / _SHIFT, _SHIFT), strict=True):
        shares = [p.share.scaled(100) for p in each.figures.points]
        value, low, high = (
            np.array([getattr(share, end) for share in shares]) for end in ("value", "low", "high")
        )
        at = np.array([p.metres for p in points])
        marks.append(Dots(at, value, side, low, high, shift=shift))
    return Plot(x, y, tuple(marks))


def _figures(found: SideRecall) -> Iterator[Figure]:
    """Recall at the thresholds, medians, skill, and the number that is not localised."""
    n, in_degrees = found.n, found.heading.scaled(180 / math.pi)
    for point in found.points:
        yield Figure("recall", point.share.scaled(100), "%", 0, point.name, n)
    yield Figure("median position", found.position, "m", n=n, text=found.position_text)
    yield Figure("median heading", in_degrees, "deg", 1, n=n, text=found.heading_text)
    yield Figure("skill", found.skill, n=n)
    lost = Interval.unknown(float(found.not_localised))
    yield Figure(NOT_LOCALISED, lost, digits=0, n=n, in_table=False)


VIEW = RecallView()
