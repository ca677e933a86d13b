"""The word for a night, and for each thing that it checked: one list for every kind of file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from s2rstore.gap_history.gate_status import (
    AxisStatus,
    NightStatus,
    axis_status,
    report_outcome,
    stored_status,
    worst_outcome,
)
from s2rstore.gap_history.reader import AxisFigures, Night
from s2rstore.metrics.bootstrap import Interval


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was checked; SKIPPED where it is not asked, ERROR where it cannot be told."""

    name: str
    word: NightStatus
    told: str


def outcome(report: dict[str, Any], stale: bool) -> str:
    """The report's; what was not judged and stale evidence pass nothing."""
    if report.get("refused"):
        return str(report["refused"]["outcome"])
    judged = report_outcome(report) or "INCONCLUSIVE"
    return worst_outcome([judged, "INCONCLUSIVE"]) if stale else judged


def checks(night: Night) -> list[Check]:
    """The headline, every axis, the golden run, and whether the evidence is fresh."""
    if night.refused:
        word: NightStatus = "ERROR" if night.outcome == "ERROR" else "INCONCLUSIVE"
        return [Check("headline", word, f"nothing was measured: {night.reason}"), _fresh(night)]
    told = night.reason
    if night.worst is not None:
        told = f"G {bounds(night.gap)}, worst axis {night.worst}; {night.reason}"
    return [
        Check("headline", stored_status(night.headline), told),
        *(axis_check(axis, night.threshold) for axis in night.axes),
        _golden(night),
        _fresh(night),
    ]


def bounds(found: Interval, digits: int = 1, sign: str = "") -> str:
    """An estimate with its bounds; `?` for what is not known."""
    value, low, high = (
        f"{round(part, digits) + 0.0:{sign}.{digits}f}" if math.isfinite(part) else "?"
        for part in (found.value, found.low, found.high)
    )
    return f"{value} ({low} .. {high})"


def axis_check(axis: AxisFigures, threshold: float) -> Check:
    """One axis against the threshold."""
    if axis.state != "measured":
        word: AxisStatus = "INCONCLUSIVE" if axis.state == "inconclusive" else "SKIPPED"
        return Check(axis.axis, word, f"{axis.state}: {axis.note}")
    value = f"{axis.measure} {bounds(axis.value, 3)} {axis.unit}, n {axis.n}"
    value += f"; {axis.note}" if axis.note else ""
    word = axis_status(axis.gap, threshold)
    if word == "SKIPPED":
        return Check(axis.axis, word, f"not judged: {value}")
    return Check(axis.axis, word, f"G {bounds(axis.gap)}, threshold {threshold:g}; {value}")


def _golden(night: Night) -> Check:
    if night.golden is None:
        return Check("golden", "SKIPPED", "no golden run in the configuration")
    change = bounds(night.golden_change, 3, "+")
    told = f"mean real error changed by {change} m, margin {night.golden_margin:g} m"
    return Check("golden", stored_status(night.golden), told)


def _fresh(night: Night) -> Check:
    days = f"{night.evidence_age} day{'' if night.evidence_age == 1 else 's'}"
    told = f"evidence is {days} old, since {night.evidence_since}, limit {night.stale_after:g} days"
    return Check("staleness", "INCONCLUSIVE" if night.stale else "PASS", told)
