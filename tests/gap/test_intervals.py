"""Few parts leave a figure more unknown, at every level."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from s2rstore.metrics.bootstrap import percentile_bounds, percentile_interval
from s2rtools.gap.bootstrap_correction import small_sample, widened


@pytest.mark.parametrize("level", [0.8, 0.95, 0.99])
def test_the_interval_of_a_normal_mean_becomes_students(level: float) -> None:
    """A normal bootstrap of b values with deviations over b, not b - 1, becomes the t interval."""
    for b in (2, 5, 30):
        tail = (1 + level) / 2
        wanted = stats.t.ppf(tail, b - 1) / np.sqrt(b)
        drawn = stats.norm.ppf(tail) * np.sqrt((b - 1) / b) / np.sqrt(b)
        assert drawn * small_sample(b, level) == pytest.approx(wanted)


def test_one_part_knows_nothing() -> None:
    found = small_sample(np.array([0.0, 1.0, 2.0]), 0.95)
    assert np.isnan(found).tolist() == [True, True, False]


def test_replicates_are_drawn_apart_about_the_value() -> None:
    drawn = np.array([[1.0, 5.0], [3.0, 5.0]])
    found = widened(drawn, np.array([2.0, 5.0]), np.array([4.0, 4.0]), 0.95)
    assert found.mean(axis=0) == pytest.approx([2.0, 5.0])
    assert np.ptp(found[:, 0]) == pytest.approx(2 * float(small_sample(4, 0.95)))


def test_what_is_unknown_has_no_bounds() -> None:
    assert np.isnan(percentile_bounds(np.zeros(0))).all()
    assert np.isnan(percentile_bounds(np.array([1.0, np.nan]))).all()
    assert percentile_interval(1.0, np.arange(101.0), 0.9).low == pytest.approx(5.0)
