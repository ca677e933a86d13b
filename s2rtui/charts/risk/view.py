"""The risk table: calibration of sigma, mean errors of the most certain, and conformal radii."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from s2rstore.intervals import Interval
from s2rstore.metrics.uncertainty import (
    ALPHA,
    COVERAGES,
    PLURALS,
    Radius,
    SideUncertainty,
    side_uncertainty,
)
from s2rstore.records import SIDES, Side
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Table, View

_NAMES = ("side", "figure", "of", "low", "value", "high", "n", "units", "unit", "reason")
_Row = tuple[object, ...]


class RiskTable(View):
    """A table without a drawing, for `s2r show`."""

    name = "risk"
    description = "risk: calibration of sigma, mean errors of the most certain, conformal radii"
    brushable = False

    def input(self, scene: Scene) -> dict[Side, SideUncertainty]:
        state = scene.state
        is_all = np.array_equal(state.selected, state.base)
        members = None if is_all else np.asarray(state.selected)
        return {
            side: side_uncertainty(scene.store, state.run, side, members, state.population)
            for side in SIDES
        }

    def numbers(self, scene: Scene) -> Table:
        sides = self.input(scene).items()
        return _NAMES, [(side, *row) for side, found in sides for row in _rows(found)]

    def summary(self, scene: Scene) -> str:
        texts = [f"{side}: {_text(found)}" for side, found in self.input(scene).items()]
        return f"Risk of {scene.state.run}. {' '.join(texts)}"


def _rows(found: SideUncertainty) -> Iterator[_Row]:
    n = found.with_sigma
    if found.calibration is None or found.risk is None:
        yield "sigma", None, None, None, None, n, None, None, found.reason
    else:
        for point in found.calibration.points:
            yield "observed share", f"p {point.p:g}", *_interval(point.share, n)
        yield "factor of sigma", None, *_interval(found.calibration.factor, n)
        risk = found.risk
        for share, value in zip(COVERAGES, risk.risks, strict=True):
            yield "mean error m", f"most certain {share:g}", *_plain(value, n)
        for order, value in (("by sigma", risk.aurc), ("by error", risk.optimal),
                             ("random", risk.random)):  # fmt: skip
            yield "AURC m", order, *_plain(value, n)
    for radius in found.radii:
        yield "radius m", radius.room, *_radius(radius.metres)
        if radius.in_sigmas is not None:
            yield "radius in sigmas", radius.room, *_radius(radius.in_sigmas)


def _interval(interval: Interval, n: int) -> _Row:
    ends = (interval.low, interval.value, interval.high)
    reason = "" if interval.is_known else interval.bounds_text()
    return *(float(end) if np.isfinite(end) else None for end in ends), n, None, None, reason


def _plain(value: float, n: int) -> _Row:
    return None, value, None, n, None, None, ""


def _radius(radius: Radius) -> _Row:
    unit = PLURALS[radius.unit]
    return None, radius.value, None, radius.n, radius.count, unit, radius.reason


def _text(found: SideUncertainty) -> str:
    """One sentence with the main figures of a side."""
    whole = found.radii[0].metres
    radius = whole.reason or (
        f"{100 * (1 - ALPHA):g} % of the images of a further {whole.unit} are expected within "
        f"{whole.value:.2f} m"
    )
    if found.calibration is None or found.risk is None:
        return f"{found.reason}; {radius}."
    factor = found.calibration.factor
    return (
        f"sigma times {factor.value:.2f} ({factor.bounds_text()}) fits the median error; AURC "
        f"{found.risk.aurc:.2f} m, by error {found.risk.optimal:.2f} m, random "
        f"{found.risk.random:.2f} m; {radius}."
    )


RISK = RiskTable()
