"""Growth of the gap over the nights of one run, selection and anchor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from s2rstore.gap_history.change_check import Change, change_of
from s2rstore.gap_history.reader import Night
from s2rstore.intervals.sequential import BASELINE
from tests.support import gaps

OF = ("tiny", "vanilla", "all")


def past(count: int, level: float = 5.0) -> list[Night]:
    rng = np.random.default_rng(0)
    return [gaps.night(number, {"task": level + rng.normal(0, 1)}) for number in range(1, count)]


def change(nights: list[Night], gap: float, anchor: float = 1.1) -> Change | None:
    return change_of(nights, *OF, {"task": (gap, anchor)})


def test_a_gap_that_grows_fails_before_it_reaches_the_threshold() -> None:
    nights = past(BASELINE + 1)
    for number in range(BASELINE + 1, BASELINE + 6):
        nights.append(gaps.night(number, {"task": 11.0}))
    found = change(nights, 11.0)
    assert found is not None
    assert found.outcome == "FAIL"
    assert found.reason.startswith(f"task: grown since measurement {BASELINE + 1} of 36 over G ")
    steady = change(past(BASELINE + 6), 5.0)
    assert steady is not None
    assert steady.outcome == "PASS"


@pytest.mark.parametrize(
    "other", [{"run": "dataaug"}, {"expression": "worst15"}, {"dataset": "lab"}, {"measured": 7}]
)
def test_nights_of_something_else_and_repeated_figures_do_not_count(other) -> None:
    nights = [replace(night, **other) for night in past(BASELINE + 6)]
    found = change(nights, 5.0)
    assert found is not None
    assert found.outcome == "INCONCLUSIVE"
    assert found.reason == f"task: {2 if 'measured' in other else 1} of 31 measurements"


def test_another_anchor_starts_again_and_an_unjudged_night_has_no_change() -> None:
    found = change(past(BASELINE + 6), 5.0, anchor=2.0)
    assert found is not None
    assert found.outcome == "INCONCLUSIVE"
    assert change_of(past(40), *OF, {}) is None
