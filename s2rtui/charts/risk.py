"""The risk view: mean errors of the most certain instances, calibration, and conformal radii."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.intervals import Interval
from s2rstore.language.canonical_text import quoted
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
from s2rtui.charts.view import StatisticsView
from s2rtui.drawing.figures import Figure, Figures
from s2rtui.drawing.plot import Line, Mark, Plot, Rule
from s2rtui.drawing.scale import Scale
from s2rtui.session.state import State

RiskModel = dict[Side, SideUncertainty]


class RiskView(StatisticsView):
    name = "risk"
    key = "%"
    description = "risk: mean errors of the most certain, calibration of sigma, conformal radii"
    about = "mean error of the instances with the smallest sigmas"
    title = "mean error of the most certain instances"

    def model(self, store: Store, state: State) -> RiskModel:
        members, population = self.members(state), state.population
        return {
            side: side_uncertainty(store, state.run, side, members, population=population)
            for side in SIDES
        }

    def figures(self, model: RiskModel) -> Figures:
        return {side: tuple(_figures(found)) for side, found in model.items()}

    def plots(self, model: RiskModel) -> tuple[Plot, ...]:
        risks = {side: found.risk for side, found in model.items() if found.risk is not None}
        return (_plot(risks),) if risks else ()

    def notes(self, model: RiskModel) -> tuple[str, ...]:
        reasons = [f"{side}: {found.reason}" for side, found in model.items() if found.reason]
        if any(found.risk is not None for found in model.values()):
            reasons.append("factor of sigma: above 1 where the stated sigmas are too small")
        radii = [radius for found in model.values() for radius in found.radii]
        units = {radius.metres.unit for radius in radii if radius.room == WHOLE}
        none = len({radius.room for radius in radii if radius.metres.reason} - {WHOLE})
        of = "trajectory or, in a room, visit" if "trajectory" in units else "visit"
        text = f"radius: holds {100 * (1 - ALPHA):g} % of the images of a further {of}"
        rooms = f"{none} {'room has' if none == 1 else 'rooms have'} too few visits"
        return (*reasons, f"{text}; {rooms}" if none else text)


def _plot(risks: dict[Side, RiskCoverage]) -> Plot:
    shares = np.array(COVERAGES)
    most = max(max(*risk.risks, risk.random) for risk in risks.values())
    x = Scale(0, 100, ("most certain instances (%)", "instances (%)", "%"))
    y = Scale(0, 1.05 * most if most > 0 else 1.0, ("mean error (m)",))
    marks: list[Mark] = [Rule(risk.random, "y", "faint") for risk in risks.values()]
    names = ["best order"] + [""] * len(risks)  # the legend explains dashes once
    for (side, risk), name in zip(risks.items(), names, strict=False):
        marks.append(Line(100 * shares, np.array(risk.ideal), side, name, dashed=True))
    for side, risk in risks.items():
        marks.append(Line(100 * shares, np.array(risk.risks), side, side))
    return Plot(x, y, tuple(marks))


def _figures(found: SideUncertainty) -> Iterator[Figure]:
    n = found.with_sigma
    if found.calibration is None or found.risk is None:
        unknown = Interval.unknown(reason=found.reason)
        yield Figure("factor of sigma", unknown, n=n, in_table=False)
    else:
        risk = found.risk
        yield Figure("factor of sigma", found.calibration.factor, n=n)
        for point in found.calibration.points:
            yield Figure("within", point.share.scaled(100), "%", 0, f"p {point.p:g}", n)
        limits = f"best {risk.optimal:.2f}, random {risk.random:.2f}"
        yield Figure("AURC", Interval.unknown(risk.aurc), "m", n=n, detail=limits)
        for order, value in (("best order", risk.optimal), ("random order", risk.random)):
            yield Figure("AURC", Interval.unknown(value), "m", of=order, n=n, in_table=False)
        for share, value in zip(COVERAGES, risk.risks, strict=True):
            of = f"most certain {100 * share:g} %"
            yield Figure("mean error", Interval.unknown(value), "m", of=of, n=n, in_table=False)
    for radius in found.radii:
        yield _radius(radius.room, radius.metres, "m")
        if radius.in_sigmas is not None:
            yield replace(_radius(radius.room, radius.in_sigmas, "sigmas"), in_table=False)


def _radius(room: str, radius: Radius, unit: str) -> Figure:
    kind = radius.unit if radius.count == 1 else PLURALS[radius.unit]
    of_room = f"room:{quoted(room)}" if room not in (WHOLE, NO_ROOM) else ""
    return Figure(
        "radius", Interval.unknown(radius.value, radius.reason), unit, of=room, n=radius.n,
        detail=f"{radius.count} {kind}", text="no radius" if radius.reason else "",
        in_table=not radius.reason or room == WHOLE, expression="all" if room == WHOLE else of_room,
    )  # fmt: skip


VIEW = RiskView()
