"""The words of a gate: which one an interval gives, and the exit code of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args

from s2rstore.errors import InconclusiveError, NotSoError, RequestError
from s2rstore.metrics.bootstrap import Interval

Outcome = Literal["PASS", "FAIL", "INCONCLUSIVE"]
Word = Outcome | Literal["SKIPPED"]
Told = Word | Literal["ERROR"]

EXIT_CODES: dict[str, int] = {
    "PASS": 0,
    "FAIL": NotSoError.exit_code,
    "ERROR": RequestError.exit_code,
    "INCONCLUSIVE": InconclusiveError.exit_code,
}
CODES_TOLD = ", ".join(f"{code} {word}" for word, code in EXIT_CODES.items())
_FROM_WORST: tuple[Outcome, ...] = ("FAIL", "INCONCLUSIVE", "PASS")
_WORDS: tuple[Word, ...] = (*get_args(Outcome), "SKIPPED")


def outcome_of(gap: Interval, threshold: float) -> Outcome:
    """The word for an interval; bounds that are not finite decide nothing."""
    if gap.high < threshold:
        return "PASS"
    return "FAIL" if gap.low > threshold else "INCONCLUSIVE"


def word_of(gap: Interval, threshold: float) -> Word:
    """The word for one axis' G; SKIPPED where it was not judged."""
    return "SKIPPED" if math.isnan(gap.value) else outcome_of(gap, threshold)


def worst(words: Iterable[Outcome]) -> Outcome:
    """The word that decides; of none PASS."""
    found = set(words)
    return next((word for word in _FROM_WORST if word in found), "PASS")


def of_report(report: Mapping[str, Any]) -> Outcome | None:
    """The worst of what a report of the gap was judged by: the scale and the golden run."""
    judged = [report["golden"]] if report["golden"] else []
    judged += [report["verdict"]] if report["reference"] else []
    return worst(each["outcome"] for each in judged) if judged else None


def known_word(text: str) -> Word:
    """A stored word; SKIPPED for what is none."""
    return next((word for word in _WORDS if word == text), "SKIPPED")
