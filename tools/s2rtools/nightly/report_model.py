"""What the files of one night tell: a pure function of the history's rows up to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from s2rstore.gap_history.reader import AxisFigures, History, Night
from s2rstore.metrics.bootstrap import LEVEL_TEXT
from s2rtools.nightly.night_status import Check, bounds, checks

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
    past = History(tuple(rows)).of_configuration(night.name)[-MOST_NIGHTS:]
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
