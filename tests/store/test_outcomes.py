"""The words of a gate and their exit codes."""

from __future__ import annotations

from typing import Any

import pytest

from s2rstore.gap_history.gate_status import EXIT_CODES, known_word, of_report, word_of, worst
from s2rstore.metrics.bootstrap import Interval


def report(headline: str, golden: str | None, judged: bool = True) -> dict[str, Any]:
    return {
        "verdict": {"outcome": headline},
        "golden": golden and {"outcome": golden},
        "reference": {"sha256": "0"} if judged else None,
    }


@pytest.mark.parametrize(
    ("headline", "golden", "judged", "word"),
    [
        ("PASS", None, True, "PASS"),
        ("PASS", "FAIL", True, "FAIL"),
        ("FAIL", "PASS", True, "FAIL"),
        ("INCONCLUSIVE", "PASS", True, "INCONCLUSIVE"),
        ("INCONCLUSIVE", "FAIL", True, "FAIL"),
        ("INCONCLUSIVE", "PASS", False, "PASS"),
        ("INCONCLUSIVE", None, False, None),
    ],
)
def test_the_worst_of_what_was_judged_decides(
    headline: str, golden: str | None, judged: bool, word: str | None
) -> None:
    assert of_report(report(headline, golden, judged)) == word


def test_words_and_codes() -> None:
    assert EXIT_CODES == {"PASS": 0, "FAIL": 1, "ERROR": 2, "INCONCLUSIVE": 3}
    assert worst([]) == "PASS"
    assert known_word("FAIL") == "FAIL"
    assert known_word("nonsense") == "SKIPPED"
    assert word_of(Interval.unknown(), 15) == "SKIPPED"
    assert word_of(Interval.unknown(3), 15) == "INCONCLUSIVE"
