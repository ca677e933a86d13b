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
from s2rtui.charts.view import DrawingView, Table
from s2rtui.drawing.plot import Cell, Column, Dots, Drawing, Line, Mark, Plot, Rule, TableSpec
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
    """The figures of the selection; of all, not localised ones included, where it is all."""
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


class RecallView(DrawingView):
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

    def numbers(self, scene: Scene) -> Table:
        names = ("side", "figure", "metres_m", "heading_deg", "value", "low", "high", "reason",
                 "unit", "n", "not_localised")  # fmt: skip
        rows: list[tuple[object, ...]] = []
        for side, curves in self.input(scene).sides.items():
            found = curves.figures
            figures: list[tuple[str, float | None, float | None, Interval, str]]
            figures = [("recall", p.metres, p.degrees, p.share, "") for p in found.points]
            figures += [
                ("median position error", None, None, found.position, "m"),
                ("median heading error", None, None, found.heading.scaled(180 / math.pi), "deg"),
                ("skill", None, None, found.skill, ""),
            ]
            for figure, metres, degrees, interval, unit in figures:
                ends = interval.as_columns("").values()
                counts = found.n, found.not_localised
                rows.append((side, figure, metres, degrees, *ends, unit, *counts))
        return names, rows

    def drawing(self, model: RecallModel) -> Drawing:
        cells = zip(*(_cells(each.figures) for each in model.sides.values()), strict=True)
        points = model.sides["real"].figures.points
        names = [*(p.name for p in points), "median position", "median heading", "skill"]
        rows = [(Cell(name), *pair) for name, pair in zip(names, cells, strict=True)]
        columns = (Column(""), *(Column(side, side) for side in model.sides))
        shares = (p.share for each in model.sides.values() for p in each.figures.points)
        reasons = [share.no_bounds for share in shares if share.no_bounds][:1]
        return Drawing(_plot(model), TableSpec(columns, tuple(rows)), (model.counted, *reasons))


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
        marks.append(Dots(at, value, side, low, high, shift))
    return Plot(x, y, tuple(marks))


def _cells(found: SideRecall) -> Iterator[Cell]:
    """The figures of a side: its recall at the thresholds, medians and skill."""
    for point in found.points:
        yield _cell(point.share.scaled(100), "{:.0f}", " %")
    yield Cell(found.position_text, _bounds(found.position, "{:.2f}"))
    yield Cell(found.heading_text, _bounds(found.heading.scaled(180 / math.pi), "{:.1f}"))
    yield _cell(found.skill, "{:.2f}")


def _cell(interval: Interval, number: str, unit: str = "") -> Cell:
    known = not math.isnan(interval.value)
    text = f"{number.format(interval.value)}{unit}" if known else "n/a"
    return Cell(text, _bounds(interval, number))


def _bounds(interval: Interval, number: str) -> str:
    return interval.bounds_text(number.format) if interval.is_known else ""


VIEW = RecallView()
