"""Outcomes of the gate: which one an interval gives, and the exit code of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args

from s2rstore.errors import CheckFailedError, InconclusiveError, RequestError
from s2rstore.intervals import Interval
from s2rstore.intervals.verdict import Outcome

AxisStatus = Outcome | Literal["SKIPPED"]
NightStatus = AxisStatus | Literal["ERROR"]

EXIT_CODES: dict[str, int] = {
    "PASS": 0,
    "FAIL": CheckFailedError.exit_code,
    "ERROR": RequestError.exit_code,
    "INCONCLUSIVE": InconclusiveError.exit_code,
}
EXIT_CODES_TEXT = ", ".join(f"{code} {word}" for word, code in EXIT_CODES.items())
_FROM_WORST: tuple[Outcome, ...] = ("FAIL", "INCONCLUSIVE", "PASS")
_STATUSES: tuple[AxisStatus, ...] = (*get_args(Outcome), "SKIPPED")


def outcome_of(gap: Interval, threshold: float) -> Outcome:
    """The outcome of an interval; INCONCLUSIVE where its bounds are not finite."""
    if gap.high < threshold:
        return "PASS"
    return "FAIL" if gap.low > threshold else "INCONCLUSIVE"


def axis_status(gap: Interval, threshold: float) -> AxisStatus:
    """The outcome of one axis' G; SKIPPED where it was not judged."""
    return "SKIPPED" if math.isnan(gap.value) else outcome_of(gap, threshold)


def worst_outcome(outcomes: Iterable[Outcome]) -> Outcome:
    """The outcome that decides: the worst; PASS where there is none."""
    present = set(outcomes)
    return next((outcome for outcome in _FROM_WORST if outcome in present), "PASS")


def report_outcome(report: Mapping[str, Any]) -> Outcome | None:
    """The worse outcome of a report's reference and golden run; None where it has neither."""
    judged = [report["golden"]] if report["golden"] else []
    judged += [report["verdict"]] if report["reference"] else []
    return worst_outcome(each["outcome"] for each in judged) if judged else None


def stored_status(text: str) -> AxisStatus:
    """The status that a text names; SKIPPED for any other text."""
    return next((status for status in _STATUSES if status == text), "SKIPPED")
