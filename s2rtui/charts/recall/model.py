"""The numbers of the recall view: curves, shares at the thresholds, medians and skill per side."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from s2rstore.intervals import Interval
from s2rstore.metrics.recall import NOT_LOCALISED, Floats, RecallCurve, RecallPoint, SideRecall

_BELOW, _BEYOND = 2.0, 8.0
"""Factors by which the axis reaches beyond the smallest and the largest threshold."""


@dataclass(frozen=True, slots=True, eq=False)
class SideCurves:
    """A side of the selection: figures and curve, and the curve of all where they are not all."""

    figures: SideRecall
    curve: RecallCurve
    everything: RecallCurve | None


@dataclass(frozen=True, eq=False)
class RecallModel:
    """Figures and curves of sim and real.

    `lost` instances in view are not localised and cannot be in the selection.
    """

    sim: SideCurves
    real: SideCurves
    lost: int = 0

    @property
    def sides(self) -> tuple[tuple[str, SideCurves], ...]:
        return ("sim", self.sim), ("real", self.real)

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Ends of the axis of positions, which is logarithmic, metres."""
        points = self.real.figures.points
        return points[0].metres / _BELOW, points[-1].metres * _BEYOND

    def fractions(self, metres: Floats) -> Floats:
        """Positions in metres as shares 0 .. 1 of the length of the axis."""
        low, high = self.limits
        return np.asarray(np.log(np.asarray(metres) / low) / math.log(high / low))

    def metres(self, fractions: Floats) -> Floats:
        """Positions at places 0 .. 1 of the axis, metres."""
        low, high = self.limits
        return np.asarray(low * (high / low) ** np.asarray(fractions))

    @property
    def counted(self) -> str:
        """`n 100 (sim 2, real 5 not localised)`."""
        figures = self.real.figures
        text = f"n {figures.n}"
        lost = [f"{name} {side.figures.not_localised}" for name, side in self.sides]
        if self.sim.figures.not_localised or figures.not_localised:
            return f"{text} ({', '.join(lost)} {NOT_LOCALISED})"
        return f"{text}; {self.lost} {NOT_LOCALISED} left out" if self.lost else text

    @property
    def axis_names(self) -> tuple[str, str]:
        """What the axis of positions shows, long and short."""
        heading = f"{self.real.curve.ratio:g} deg per m"
        return f"position within (m), heading within {heading}", f"heading: {heading}"

    @property
    def reason(self) -> str:
        """Why a figure has no interval; empty where all have one."""
        shares = [point.share for _, side in self.sides for point in side.figures.points]
        unknown = [share.bounds_text() for share in shares if not share.is_known]
        return unknown[0] if unknown else ""

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """(name, sim, its bounds, real, its bounds) of every figure, as texts."""
        sim, real = self.sim.figures, self.real.figures
        pairs = zip(sim.points, real.points, strict=True)
        return [
            *((a.name, *_share(a), *_share(b)) for a, b in pairs),
            ("median position", sim.position_text, _metres(sim.position), real.position_text,
             _metres(real.position)),
            ("median heading", sim.heading_text, _degrees(sim.heading), real.heading_text,
             _degrees(real.heading)),
            ("skill", *_skill(sim.skill), *_skill(real.skill)),
        ]  # fmt: skip


def _share(point: RecallPoint) -> tuple[str, str]:
    share = point.share.scaled(100)
    value = f"{share.value:.0f} %" if share.value == share.value else "n/a"
    return value, share.bounds_text("{:.0f}".format) if share.is_known else ""


def _metres(median: Interval) -> str:
    return median.bounds_text() if median.is_known else ""


def _degrees(median: Interval) -> str:
    in_degrees = median.scaled(180 / math.pi)
    return in_degrees.bounds_text("{:.1f}".format) if median.is_known else ""


def _skill(skill: Interval) -> tuple[str, str]:
    value = f"{skill.value:.2f}" if skill.value == skill.value else "n/a"
    return value, skill.bounds_text() if skill.is_known else ""
