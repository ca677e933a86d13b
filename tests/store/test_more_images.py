"""How many more real images a plan asks for, and whether they keep what it promises."""

from __future__ import annotations

import numpy as np
import pytest

from s2rstore import intervals
from s2rstore.intervals import Interval, Sample
from s2rstore.metrics.more_images import decided, half_width, images_for_width, images_to_decide


def test_a_width_needs_its_square_in_images() -> None:
    present = Interval(-1.0, 0.0, 1.0, sample=Sample(400, 400, 1))
    few = images_for_width(present, 0.5)
    assert 900 < few.images < 1200  # four times as many, with more degrees of freedom
    assert few.visits == 0
    assert 0 < images_for_width(present, 0.5, rate=2.0).images < few.images / 2
    assert images_for_width(present, 1.0).images == 0


def test_simulated_images_are_no_further_visits() -> None:
    present = Interval(-1.0, 0.0, 1.0, sample=Sample(300, 300, 3))
    assert half_width(present, 1.0, rate=4.0) == pytest.approx(half_width(present, 1.0) / 2)
    assert half_width(present, 4.0) < half_width(present, 1.0) / 2  # twelve visits in place of 3


def test_visits_are_planned_where_visits_differ() -> None:
    present = Interval(-1.0, 0.2, 1.4, sample=Sample(400, 100, 4))
    plan = images_to_decide(present, 0.8)
    assert plan.images == pytest.approx(100 * plan.visits, rel=0.3)
    assert "more visit" in plan.text


@pytest.mark.parametrize(
    ("interval", "reason"),
    [
        (Interval.unknown(0.3, "n 7, a mean needs 100"), "no interval: n 7, a mean needs 100"),
        (Interval(-np.inf, 0.3, 1.0, sample=Sample(30, 30, 1)), "the interval is open"),
        (Interval(-9.0, 0.01, 9.0, sample=Sample(100, 90, 1)), "more than 50 times"),
    ],
)
def test_a_number_that_is_not_known_has_a_reason(interval: Interval, reason: str) -> None:
    assert images_for_width(interval, 0.1).text.startswith(reason)


def test_promised_power_is_kept() -> None:
    """Over differences of all sizes, the share of decisions equals the promised one."""
    rng = np.random.default_rng(5)
    promised, kept = [], []
    for _ in range(400):
        truth = rng.uniform(-1.2, 1.2)
        pilot = truth + 3 * rng.standard_normal(100)
        interval = intervals.paired_difference(pilot)
        factor = float(rng.choice([2.0, 4.0]))
        more = truth + 3 * rng.standard_normal(int(100 * (factor - 1)))
        promised.append(decided(interval, factor))
        together = intervals.paired_difference(np.concatenate([pilot, more]))
        kept.append(together.excludes_zero)
    assert np.mean(promised) == pytest.approx(np.mean(kept), abs=0.05)
