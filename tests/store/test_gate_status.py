"""Gate outcomes and their exit codes."""

from typing import Any

import pytest

from s2rstore.gap_history.gate_status import (
    EXIT_CODES,
    axis_status,
    report_outcome,
    stored_status,
    worst_outcome,
)
from s2rstore.intervals import Interval


def report(headline: str, golden: str | None, judged: bool = True) -> dict[str, Any]:
    return {
        "verdict": {"outcome": headline},
        "golden": golden and {"outcome": golden},
        "reference": {"sha256": "0"} if judged else None,
    }


@pytest.mark.parametrize(
    ("headline", "golden", "judged", "outcome"),
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
def test_the_worst_judged_outcome_decides(headline, golden, judged, outcome):
    assert report_outcome(report(headline, golden, judged)) == outcome


def test_outcomes_and_exit_codes():
    assert EXIT_CODES == {"PASS": 0, "FAIL": 1, "ERROR": 2, "INCONCLUSIVE": 3}
    assert worst_outcome([]) == "PASS"
    assert stored_status("FAIL") == "FAIL"
    assert stored_status("nonsense") == "SKIPPED"
    assert axis_status(Interval.unknown(), 15) == "SKIPPED"
    assert axis_status(Interval.unknown(3), 15) == "INCONCLUSIVE"
