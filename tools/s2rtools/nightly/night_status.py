"""The word for a night, and for each thing that it checked: one list for every kind of file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from s2rstore.gap_history.gate_status import Told, Word, known_word, of_report, word_of, worst
from s2rstore.gap_history.reader import AxisFigures, History, Night
from s2rstore.metrics.bootstrap import LEVEL_TEXT, Interval


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was checked; SKIPPED where it is not asked, ERROR where it cannot be told."""

    name: str
    word: Told
    told: str


def outcome(report: dict[str, Any], stale: bool) -> str:
    """The report's; what was not judged and stale evidence pass nothing."""
    if report.get("refused"):
        return str(report["refused"]["outcome"])
    judged = of_report(report) or "INCONCLUSIVE"
    return worst([judged, "INCONCLUSIVE"]) if stale else judged


def checks(night: Night) -> list[Check]:
    """The headline, every axis, the golden run, and whether the evidence is fresh."""
    if night.refused:
        word: Told = "ERROR" if night.outcome == "ERROR" else "INCONCLUSIVE"
        return [Check("headline", word, f"nothing was measured: {night.reason}"), _fresh(night)]
    told = night.reason
    if night.worst is not None:
        told = f"G {bounds(night.gap)}, worst axis {night.worst}; {night.reason}"
    return [
        Check("headline", known_word(night.headline), told),
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
        word: Word = "INCONCLUSIVE" if axis.state == "inconclusive" else "SKIPPED"
        return Check(axis.axis, word, f"{axis.state}: {axis.note}")
    value = f"{axis.measure} {bounds(axis.value, 3)} {axis.unit}, n {axis.n}"
    value += f"; {axis.note}" if axis.note else ""
    word = word_of(axis.gap, threshold)
    if word == "SKIPPED":
        return Check(axis.axis, word, f"not judged: {value}")
    return Check(axis.axis, word, f"G {bounds(axis.gap)}, threshold {threshold:g}; {value}")


def _golden(night: Night) -> Check:
    if night.golden is None:
        return Check("golden", "SKIPPED", "no golden run in the configuration")
    change = bounds(night.golden_change, 3, "+")
    told = f"mean real error changed by {change} m, margin {night.golden_margin:g} m"
    return Check("golden", known_word(night.golden), told)


def _fresh(night: Night) -> Check:
    days = f"{night.evidence_age} day{'' if night.evidence_age == 1 else 's'}"
    told = f"evidence is {days} old, since {night.evidence_since}, limit {night.stale_after:g} days"
    return Check("staleness", "INCONCLUSIVE" if night.stale else "PASS", told)


MOST_NIGHTS = 90
"""That tables and plots go back."""


@dataclass(frozen=True, slots=True)
class Content:
    """A night, its checks, and the nights up to it (itself last), each once."""

    night: Night
    checks: tuple[Check, ...]
    past: tuple[Night, ...]

    @property
    def title(self) -> str:
        return f"{self.night.name}: {self.night.outcome}, {self.night.night}"


def content(found: History, night: Night) -> Content:
    """Later rows do not change what was told before them."""
    rows = [each for each in found.nights if each.id <= night.id and each.night <= night.night]
    past = History(tuple(rows)).counting(night.name)[-MOST_NIGHTS:]
    return Content(night, tuple(checks(night)), past)


def axes_of(past: tuple[Night, ...]) -> list[str]:
    """All axes that any night has judged, in the order of the newest."""
    axes = (axis for night in reversed(past) for axis in night.axes)
    return list(dict.fromkeys(axis.axis for axis in axes if math.isfinite(axis.gap.value)))


def figures_of(night: Night, axis: str) -> AxisFigures | None:
    """One axis of a night."""
    return next((each for each in night.axes if each.axis == axis), None)


def facts(night: Night) -> list[tuple[str, str]]:
    """What the night was about."""
    return [
        ("data set", f"{night.dataset} ({night.dataset_hash[:12]})"),
        ("run", f"{night.run} (model {night.model})"),
        ("selection", night.expression),
        ("threshold", f"{night.threshold:g}"),
        ("evidence since", f"{night.evidence_since}, {night.evidence_age} days old"),
        ("written", night.written_at),
        ("key", night.key[:12]),
    ]


CHECKS = ("check", "result", "what was found")
PAST = ("night", "result", f"G ({LEVEL_TEXT})", "worst axis", "evidence, days")
ESTIMATES = ("parameter", f"estimate ({LEVEL_TEXT})", "unit", "note")


def check_rows(told: Content) -> list[tuple[str, ...]]:
    return [(each.name, each.word, each.told) for each in told.checks]


def past_rows(told: Content) -> list[tuple[str, ...]]:
    """The newest night first."""
    return [
        (str(n.night), n.outcome, bounds(n.gap), n.worst or "-", str(n.evidence_age))
        for n in reversed(told.past)
    ]


def estimate_rows(told: Content) -> list[tuple[str, ...]]:
    return [
        (each.parameter, bounds(each.value, 4), each.unit, each.note or "")
        for each in told.night.estimates
    ]
