"""Intervals of medians: exact replicates, coverage, differences, and several comparisons."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from s2rstore.metrics.bootstrap import BootstrapSettings, Interval

from s2rstore.metrics import bootstrap, median_intervals


def correlated(rng: np.random.Generator, n: int, correlation: float) -> np.ndarray:
    """Log-normal values with median 1 and a correlation between neighbours."""
    values = rng.normal(size=n)
    for index in range(1, n):
        noise = math.sqrt(1 - correlation**2) * values[index]
        values[index] = correlation * values[index - 1] + noise
    return np.exp(values)


def test_replicates_are_the_medians_of_the_drawn_blocks():
    rng = np.random.default_rng(1)
    values, settings = rng.gamma(2.0, size=57), BootstrapSettings(200)
    blocks = bootstrap.split_into_blocks(np.zeros(57, dtype=np.int64))
    counts = bootstrap.block_counts(blocks, settings).astype(int)
    parts = [values[a:b] for a, b in zip(blocks.start[:-1], blocks.start[1:], strict=True)]
    drawn = [np.median(np.concatenate(list(map(np.tile, parts, row)))) for row in counts]
    expected = bootstrap.corrected(np.array(drawn), float(np.median(values)), blocks.unit_count)
    replicates = median_intervals.median_replicates(values, blocks, settings)
    assert replicates == pytest.approx(expected)


def test_many_values_give_nearly_the_replicates_of_their_ranks():
    values = np.random.default_rng(2).normal(size=20_000)
    blocks = bootstrap.split_into_blocks(np.zeros(values.size, dtype=np.int64))
    settings = BootstrapSettings(50)
    counts = bootstrap.block_counts(blocks, settings)
    weights = np.repeat(counts, np.diff(blocks.start), axis=1)
    order = np.argsort(values)
    below = np.cumsum(weights[:, order], axis=1)
    exact = values[order][(below >= below[:, -1:] / 2).argmax(axis=1)]
    expected = bootstrap.corrected(exact, float(np.median(values)), blocks.unit_count)
    replicates = median_intervals.median_replicates(values, blocks, settings)
    assert np.abs(replicates - expected).max() < 0.005


@pytest.mark.parametrize(("n", "correlation"), [(8, 0.6), (150, 0.6)])
def test_the_interval_covers_the_median(n, correlation):
    rng = np.random.default_rng(n)
    codes, settings, hits = np.zeros(n, dtype=np.int64), BootstrapSettings(300), 0
    for _ in range(150):
        interval = median_intervals.median_interval(
            correlated(rng, n, correlation), codes, settings
        )
        hits += interval.low <= 1 <= interval.high
    assert hits >= 0.85 * 150


@given(
    st.lists(st.floats(-50, 50, allow_nan=False), min_size=6, max_size=60),
    st.integers(1, 9),
)
def test_no_bound_lies_beyond_the_values(numbers, trajectories):
    values = np.array(numbers)
    codes = np.arange(values.size) * trajectories // values.size
    interval = median_intervals.median_interval(values, codes, BootstrapSettings(60))
    if not math.isnan(interval.low):
        assert values.min() <= interval.low <= interval.value <= interval.high <= values.max()
        low, high = interval.tested_bounds
        assert low <= interval.low
        assert high >= interval.high


GAINS = np.array([0.4, 0.9, 1.2, 3.3, 5.8, 6.0, 9.2])
"""Changes of neighbouring instances, all of one sign."""


def test_seven_neighbours_on_one_side_are_bounded_but_not_evident():
    """They are two blocks of neighbours, which may lie on one side by chance."""
    interval = median_intervals.median_interval(GAINS)
    assert (interval.low, interval.high) == (0.4, 9.2)
    assert not interval.excludes_zero
    assert interval.bound_texts(lambda bound: f"{bound:g}") == ("<0.4", ">9.2")
    assert median_intervals.median_interval(GAINS + 60).is_positive
    assert median_intervals.median_interval(-GAINS - 60).is_negative


def test_six_units_on_one_side_are_evident_however_far_the_bootstrap_goes():
    values = np.repeat([0.1, 0.2, 0.3, 30.0, 60.0, 80.0], 3) + np.tile([0.0, 0.01, 0.02], 6)
    codes, few = np.repeat(np.arange(6), 3), BootstrapSettings(300)
    blocks = bootstrap.split_into_blocks(codes)
    assert blocks.unit_count == 6
    assert np.percentile(median_intervals.median_replicates(values, blocks, few), 2.5) < 0
    interval = median_intervals.median_interval(values, codes, few)
    assert interval.low == values.min()
    assert interval.is_positive
    fewer = median_intervals.median_interval(values[:15], codes[:15], few)
    assert fewer.tested_bounds[0] < fewer.low == 0.1


@pytest.mark.parametrize("n", [1, 5, 6, 8])
def test_too_few_values_have_no_interval(n):
    values, codes = np.arange(n, dtype=np.float64), np.zeros(n, dtype=np.int64)
    interval = median_intervals.median_interval(values, codes)
    assert interval.value == np.median(values)
    assert math.isnan(interval.low) == (n < 6)
    strict = median_intervals.median_interval(values, codes, bootstrap.simultaneous(10))
    assert math.isnan(strict.low)


def test_differences_add_the_distances_to_the_bounds_in_squares():
    difference = bootstrap.difference_of(Interval(4.0, 7.0, 8.0), Interval(1.0, 2.0, 6.0))
    assert (difference.low, difference.value, difference.high) == pytest.approx(
        (5 - 5.0, 5.0, 5 + math.sqrt(2))
    )
    limited = Interval(4.0, 7.0, 8.0, tested=(-1.0, 8.0))
    near = bootstrap.difference_of(limited, Interval(1.0, 2.0, 6.0))
    assert near.low == difference.low
    assert near.tested_bounds == pytest.approx((5 - math.hypot(8, 4), 5 + math.sqrt(2)))
    unknown = bootstrap.difference_of(Interval(4.0, 7.0, 8.0), Interval.unknown(2.0))
    assert unknown.value == 5.0
    assert not unknown.excludes_zero


def test_one_of_many_equal_groups_seldom_seems_to_differ():
    """Ten groups of one distribution: the corrected interval of the most deviant holds zero."""
    rng = np.random.default_rng(5)
    settings = bootstrap.simultaneous(10, BootstrapSettings(200))
    codes, false_alarms = np.zeros(40, dtype=np.int64), 0
    for _ in range(40):
        groups = [rng.gamma(2.0, size=40) for _ in range(10)]
        most = max(groups, key=np.median)
        others = np.concatenate([group for group in groups if group is not most])
        far = median_intervals.median_interval(others, np.zeros(360, dtype=np.int64), settings)
        near = median_intervals.median_interval(most, codes, settings)
        false_alarms += bootstrap.difference_of(near, far).low > 0
    assert settings.level == pytest.approx(0.995)
    assert false_alarms <= 4


def test_ranks_bound_the_median_of_many_values_as_resampling_does(monkeypatch):
    rng = np.random.default_rng(6)
    levels = np.repeat(rng.normal(size=12), 2500)
    values = levels + np.log(correlated(rng, levels.size, 0.8))
    for codes in (np.zeros(levels.size, dtype=np.int64), np.arange(levels.size) // 2500):
        by_rank = median_intervals.median_interval(values, codes)
        with monkeypatch.context() as patch:
            patch.setattr(median_intervals, "MOST_RESAMPLED", values.size)
            resampled = median_intervals.median_interval(values, codes)
        width = resampled.high - resampled.low
        assert by_rank.value == resampled.value
        assert by_rank.low == pytest.approx(resampled.low, abs=0.2 * width)
        assert by_rank.high == pytest.approx(resampled.high, abs=0.2 * width)
        assert by_rank.low in values
        assert by_rank.high in values


def test_ranks_bound_the_median_of_independent_values_on_both_sides_alike():
    """Replicates that are rounded up to 1024 ranks would lie too high by half the interval."""
    values = np.random.default_rng(7).permutation(np.arange(1_000_001.0))
    interval = median_intervals.median_interval(values, np.zeros(values.size, dtype=np.int64))
    below, above = interval.value - interval.low, interval.high - interval.value
    assert below == above
    assert 980 <= below <= 1100


def test_units_that_disagree_on_everything_bound_the_median_by_all_values():
    values = np.repeat([1.0, 9.0], 15_000)
    interval = median_intervals.median_interval(values, np.repeat([0, 1], 15_000))
    wide = median_intervals.median_bound_rank(
        values, 5.0, np.repeat([0, 1], 15_000), BootstrapSettings(block_length=15_000)
    )
    assert (interval.low, interval.high) == (1.0, 9.0)
    assert wide == 1


def test_levels_beyond_the_replicates_are_those_of_a_normal_estimate():
    """At 400 comparisons not one of 4000 replicates lies beyond a bound."""
    drawn = np.random.default_rng(9).normal(size=4000)
    settings = bootstrap.simultaneous(400)
    far = bootstrap.percentile_interval(0.0, drawn, settings.level)
    assert settings.replicates == 4000
    assert far.level == settings.level
    assert far.high == pytest.approx(3.84, abs=0.35)  # the normal quantile at 1 - 0.025 / 400
    assert far.high > drawn.max() - 0.5
    near = bootstrap.percentile_interval(0.0, drawn)
    assert (near.low, near.high) == bootstrap.percentile_bounds(drawn)


def test_an_interval_at_another_level_keeps_its_shape():
    interval = Interval(1.0, 3.0, 7.0).at_level(0.9973)
    assert interval.value == 3.0
    assert (3 - interval.low) / 2 == pytest.approx((interval.high - 3) / 4)
    assert (3 - interval.low) / 2 == pytest.approx(3 / 1.96, abs=1e-3)
