"""The risk view: mean errors of the most certain instances, calibration, and conformal radii."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from s2rstore.index.population import Population
from s2rstore.intervals import Interval
from s2rstore.metrics.uncertainty import (
    ALPHA,
    COVERAGES,
    PLURALS,
    WHOLE,
    Radius,
    RiskCoverage,
    SideUncertainty,
    side_uncertainty,
)
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import DrawingView, Table
from s2rtui.drawing.plot import Cell, Column, Drawing, Line, Mark, Plot, Rule, TableSpec
from s2rtui.drawing.scale import Scale
from s2rtui.session import State

_Row = tuple[object, ...]
RiskModel = dict[Side, SideUncertainty]


@cached_by_identity(8)
def risk_model(
    store: Store, run: str, selected: Bools, base: Bools, population: Population
) -> RiskModel:
    """Both sides of the selection; of all, not localised ones included, where it is all."""
    members = None if np.array_equal(selected, base) else np.asarray(selected)
    return {
        side: side_uncertainty(store, run, side, members, population=population) for side in SIDES
    }


class RiskView(DrawingView):
    name = "risk"
    key = "%"
    description = "risk: mean errors of the most certain, calibration of sigma, conformal radii"
    title = "mean error of the most certain instances"
    narrow_ratio = 1.8
    wide_ratio = 0.8

    def subtitle(self, scene: Scene) -> str:
        return "mean error of the instances with the smallest sigmas"

    def model(self, store: Store, state: State) -> RiskModel:
        return risk_model(store, state.run, state.selected, state.base, state.population)

    def numbers(self, scene: Scene) -> Table:
        names = ("side", "figure", "of", "value", "low", "high", "reason", "unit", "n", "units",
                 "units_are")  # fmt: skip
        sides = self.input(scene).items()
        return names, [(side, *row) for side, found in sides for row in _rows(found)]

    def drawing(self, model: RiskModel) -> Drawing:
        risks = {side: each.risk for side, each in model.items() if each.risk is not None}
        reasons = [f"{side}: {each.reason}" for side, each in model.items() if each.reason]
        radius = f"radius: holds {100 * (1 - ALPHA):g} % of the images of a further visit"
        if any(each.radii and each.radii[0].metres.unit == "trajectory" for each in model.values()):
            radius = radius.replace("visit", "trajectory or, in a room, visit")
        if risks:
            reasons.append("factor of sigma: above 1 where the stated sigmas are too small")
        rooms = {
            radius.room
            for each in model.values()
            for radius in each.radii[1:]
            if radius.metres.reason
        }
        if rooms:
            radius += f"; {len(rooms)} {'room has' if len(rooms) == 1 else 'rooms have'} none"
        return Drawing(_plot(risks) if risks else None, _table(model), (*reasons, radius))


def _plot(risks: dict[Side, RiskCoverage]) -> Plot:
    shares = np.array(COVERAGES)
    most = max(max(*risk.risks, risk.random) for risk in risks.values())
    x = Scale(0, 100, ("most certain instances (%)", "instances (%)", "%"))
    y = Scale(0, 1.05 * most if most > 0 else 1.0, ("mean error (m)",))
    marks: list[Mark] = [Rule(risk.random, "y", "faint") for risk in risks.values()]
    for side, risk in risks.items():
        marks.append(Line(100 * shares, np.array(risk.ideal), side, f"{side}, best order", True))
    for side, risk in risks.items():
        marks.append(Line(100 * shares, np.array(risk.risks), side, f"{side}, by sigma"))
    return Plot(x, y, tuple(marks))


def _table(model: RiskModel) -> TableSpec:
    names: dict[str, None] = {}
    cells: dict[Side, dict[str, Cell]] = {}
    for side, found in model.items():
        cells[side] = dict(_cells(found))
        names |= dict.fromkeys(cells[side])
    rows = tuple(
        (Cell(name), *(cells[side].get(name, Cell("")) for side in model)) for name in names
    )
    return TableSpec((Column(""), *(Column(side, side) for side in model)), rows)


def _cells(found: SideUncertainty) -> Iterator[tuple[str, Cell]]:
    """The figures of a side by name."""
    if found.calibration is not None and found.risk is not None:
        factor, risk = found.calibration.factor, found.risk
        yield "factor of sigma", Cell(f"{factor.value:.2f}", factor.bounds_text())
        yield (
            "AURC",
            Cell(f"{risk.aurc:.2f} m", f"best {risk.optimal:.2f}, random {risk.random:.2f}"),
        )
        for point in found.calibration.points:
            share = point.share.scaled(100)
            bounds = share.bounds_text("{:.0f}".format) if share.is_known else ""
            yield f"within p {point.p:g}", Cell(f"{share.value:.0f} %", bounds)
    for radius in found.radii:
        metres = radius.metres
        if metres.reason and radius.room != WHOLE:
            continue
        count = f"{metres.count} {metres.unit if metres.count == 1 else PLURALS[metres.unit]}"
        text = f"{metres.value:.2f} m" if not metres.reason else "no radius"
        yield f"radius {radius.room}", Cell(text, count)


def _rows(found: SideUncertainty) -> Iterator[_Row]:
    n = found.with_sigma
    if found.calibration is None or found.risk is None:
        yield "sigma", None, None, None, None, found.reason, None, n, None, None
    else:
        for point in found.calibration.points:
            yield "observed share", f"p {point.p:g}", *_interval(point.share), "", n, None, None
        factor = _interval(found.calibration.factor)
        yield "factor of sigma", None, *factor, "", n, None, None
        risk = found.risk
        for share, value in zip(COVERAGES, risk.risks, strict=True):
            plain = value, None, None, None, "m", n, None, None
            yield "mean error", f"most certain {share:g}", *plain
        for order, value in (("by sigma", risk.aurc), ("by error", risk.optimal),
                             ("random", risk.random)):  # fmt: skip
            yield "AURC", order, value, None, None, None, "m", n, None, None
    for radius in found.radii:
        yield "radius", radius.room, *_radius(radius.metres, "m")
        if radius.in_sigmas is not None:
            yield "radius", radius.room, *_radius(radius.in_sigmas, "sigmas")


def _interval(interval: Interval) -> _Row:
    return tuple(interval.as_columns("").values())


def _radius(radius: Radius, unit: str) -> _Row:
    kind = PLURALS[radius.unit]
    return radius.value, None, None, radius.reason or None, unit, radius.n, radius.count, kind


VIEW = RiskView()
