"""Content of a night's report: outcome, checks, and tables, the same for every file format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from s2rstore.errors import counted
from s2rstore.gap_history.change_check import Change
from s2rstore.gap_history.gate_status import (
    AxisStatus,
    NightStatus,
    axis_status,
    report_outcome,
    stored_status,
    worst_outcome,
)
from s2rstore.gap_history.reader import AxisFigures, History, Night
from s2rstore.intervals import LEVEL_TEXT, Interval

MAX_NIGHTS = 90
"""Number of nights in tables and plots."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts with its title."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Check:
    """One check of a night: SKIPPED where it is not configured, ERROR where it failed to run."""

    name: str
    outcome: NightStatus
    message: str


@dataclass(frozen=True, slots=True)
class NightReport:
    """A night, its checks, and the nights up to it (itself last), each once."""

    night: Night
    checks: tuple[Check, ...]
    past: tuple[Night, ...]

    @property
    def title(self) -> str:
        return f"{self.night.name}: {self.night.outcome}, {self.night.night}"

    def axis_names(self) -> list[str]:
        """All axes that were judged in any of the nights, in the order of the newest night."""
        axes = (axis for night in reversed(self.past) for axis in night.axes)
        return list(dict.fromkeys(axis.axis for axis in axes if math.isfinite(axis.gap.value)))

    def facts(self) -> list[tuple[str, str]]:
        """Names and values that describe the measured data."""
        night = self.night
        return [
            ("data set", f"{night.dataset} ({night.dataset_hash[:12]})"),
            ("run", f"{night.run} ({f'model {night.model}' if night.model else 'imported'})"),
            ("selection", night.expression),
            ("threshold", f"{night.threshold:g}"),
            ("evidence since", f"{night.evidence_since}, {night.evidence_age} days old"),
            ("written", night.written_at),
            ("key", night.key[:12]),
        ]

    def tables(self) -> list[Table]:
        """The checks, the estimated parameters if there are any, and the nights, newest first."""
        interval, night = f"({LEVEL_TEXT})", self.night
        estimates = [
            (each.parameter, format_interval(each.value, 4), each.unit, each.note or "")
            for each in night.estimates
        ]
        tables = [
            Table(
                "Checks", ("check", "result", "details"),
                [(each.name, each.outcome, each.message) for each in self.checks],
            ),
            Table(
                "Estimates of the simulator",
                ("parameter", f"estimate {interval}", "unit", "note"), estimates,
            ),
            Table(
                "Nights",
                ("night", "result", f"G {interval}", "worst axis", "age of evidence, days"),
                [
                    (str(n.night), n.outcome, format_interval(n.gap), n.worst or "-",
                     str(n.evidence_age))
                    for n in reversed(self.past)
                ],
            ),
        ]  # fmt: skip
        return [table for table in tables if table.rows]


def night_report(history: History, night: Night) -> NightReport:
    """The report of a night from the rows of the history up to it; later rows do not change it."""
    rows = [each for each in history.nights if each.id <= night.id and each.night <= night.night]
    past = History(tuple(rows)).of_configuration(night.name)[-MAX_NIGHTS:]
    return NightReport(night, tuple(checks(night)), past)


def outcome(report: dict[str, Any], change: Change | None, stale: bool) -> str:
    """Outcome of a night; unjudged or stale evidence turns PASS into INCONCLUSIVE.

    Growth fails it; that too few nights are known to tell growth does not change it.
    """
    if report.get("refused"):
        return str(report["refused"]["outcome"])
    judged = report_outcome(report) or "INCONCLUSIVE"
    if change is not None and change.outcome == "FAIL":
        judged = "FAIL"
    return worst_outcome([judged, "INCONCLUSIVE"]) if stale else judged


def checks(night: Night) -> list[Check]:
    """Checks of the headline, every axis, the growth, the golden run, and the evidence's age.

    The outcome of an axis is that of its interval of this single night.
    """
    if night.refused:
        failed: NightStatus = "ERROR" if night.outcome == "ERROR" else "INCONCLUSIVE"
        message = f"nothing was measured: {night.reason}"
        return [Check("headline", failed, message), _staleness_check(night)]
    message = night.reason
    if night.worst is not None:
        message = f"G {format_interval(night.gap)}, worst axis {night.worst}; {night.reason}"
    return [
        Check("headline", stored_status(night.headline), message),
        *(axis_check(axis, night.threshold) for axis in night.axes),
        _change_check(night),
        _golden_check(night),
        _staleness_check(night),
    ]


def format_interval(interval: Interval, digits: int = 1, sign: str = "") -> str:
    """An estimate with its bounds, or the reason why it has none."""
    return interval.with_bounds(lambda number: f"{round(number, digits) + 0.0:{sign}.{digits}f}")


def axis_check(axis: AxisFigures, threshold: float) -> Check:
    """Check of one axis against the threshold."""
    if axis.state != "measured":
        unmeasured: AxisStatus = "INCONCLUSIVE" if axis.state == "inconclusive" else "SKIPPED"
        return Check(axis.axis, unmeasured, f"{axis.state}: {axis.note}")
    value = f"{axis.measure} {format_interval(axis.value, 3)} {axis.unit}, n {axis.n}"
    value += f"; {axis.note}" if axis.note else ""
    status = axis_status(axis.gap, threshold)
    if status == "SKIPPED":
        return Check(axis.axis, status, f"not judged: {value}")
    gap = f"single night: G {format_interval(axis.gap)}, threshold {threshold:g}"
    return Check(axis.axis, status, f"{gap}; {value}")


def _change_check(night: Night) -> Check:
    if night.change is None:
        return Check("growth", "SKIPPED", "no axis was judged")
    return Check("growth", stored_status(night.change), str(night.change_reason))


def _golden_check(night: Night) -> Check:
    if night.golden is None:
        return Check("golden", "SKIPPED", "no golden run in the configuration")
    change = format_interval(night.golden_change, 3, "+")
    message = f"mean real error changed by {change} m, margin {night.golden_margin:g} m"
    return Check("golden", stored_status(night.golden), message)


def _staleness_check(night: Night) -> Check:
    days = counted(night.evidence_age, "day")
    limit = f"limit {night.stale_after:g} days"
    message = f"evidence is {days} old, since {night.evidence_since}, {limit}"
    return Check("staleness", "INCONCLUSIVE" if night.stale else "PASS", message)
