"""Bootstrap intervals: coverage, small-sample correction, agreement of screen and gate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from s2rstore.metrics.bootstrap import BootstrapSettings, Interval
from scipy import stats

import s2rstore
from s2rstore.metrics import bootstrap, run_metrics
from s2rtools.gap.axes import axis
from s2rtools.gap.axis_result import Evidence, GapSettings
from tests.support import tiny


@pytest.mark.parametrize("level", [0.8, 0.95, 0.99])
def test_student_quantiles_equal_scipy(level):
    for freedom in (*range(1, 40), 199, 200, 201, 1000, 100_000):
        expected = stats.t.ppf((1 + level) / 2, freedom)
        assert bootstrap.student_quantile(freedom, level) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("level", [0.8, 0.95, 0.99])
def test_the_corrected_interval_of_a_normal_mean_is_student_s(level):
    """A normal bootstrap of b values divides by b, not by b - 1; the correction restores it."""
    for b in (2, 5, 30):
        tail = (1 + level) / 2
        expected = stats.t.ppf(tail, b - 1) / np.sqrt(b)
        half_width = stats.norm.ppf(tail) * np.sqrt((b - 1) / b) / np.sqrt(b)
        assert half_width * bootstrap.correction_factor(b, level) == pytest.approx(expected)


def test_fewer_than_two_blocks_have_no_correction():
    factors = bootstrap.correction_factor(np.array([0.0, 1.0, 2.0]), 0.95)
    assert np.isnan(factors).tolist() == [True, True, False]


def test_correction_widens_replicates_around_the_value():
    replicates = np.array([[1.0, 5.0], [3.0, 5.0]])
    widened = bootstrap.corrected(replicates, np.array([2.0, 5.0]), np.array([4.0, 4.0]), 0.95)
    assert widened.mean(axis=0) == pytest.approx([2.0, 5.0])
    assert np.ptp(widened[:, 0]) == pytest.approx(2 * float(bootstrap.correction_factor(4, 0.95)))


def test_unknown_replicates_have_no_bounds():
    assert np.isnan(bootstrap.percentile_bounds(np.zeros(0))).all()
    assert np.isnan(bootstrap.percentile_bounds(np.array([1.0, np.nan]))).all()
    assert bootstrap.percentile_interval(1.0, np.arange(101.0), 0.9).low == pytest.approx(5.0)


@pytest.mark.parametrize("units", [3, 6])
def test_few_blocks_have_the_nominal_coverage(units):
    """Without the correction, intervals over 4 blocks cover the mean in 75 % of the cases."""
    rng, covered = np.random.default_rng(units), []
    for _ in range(400):
        values = np.repeat(rng.normal(1, 1, units), 5) + rng.normal(0, 0.1, 5 * units)
        settings = BootstrapSettings(300, block_length=5)
        interval = bootstrap.mean_interval(values, settings=settings)
        covered.append(interval.low <= 1 <= interval.high)
    assert 0.90 <= np.mean(covered) <= 0.99


@given(st.integers(1, 30), st.integers(1, 12), st.integers(1, 4), st.integers(0, 99))
def test_circular_block_sums_equal_sums_of_wrapped_rows(n, length, parts, seed):
    length = min(length, n)
    rng = np.random.default_rng(seed)
    values, starts = rng.normal(size=(2, n)), rng.integers(0, n, (5, parts))
    rows = (starts[:, :, None] + np.arange(length)) % n
    expected = values[:, rows.reshape(5, -1)].sum(axis=2)
    assert np.allclose(bootstrap.circular_block_sums(values, length, starts), expected)


def test_too_few_values_have_an_estimate_without_bounds():
    assert np.isnan(bootstrap.mean_interval(np.zeros(0)).value)
    single = bootstrap.mean_interval(np.ones(1))
    assert single.value == 1
    assert np.isnan(single.low)
    assert Interval(-0.2, 0.9, 1.3).clipped(0, 1) == Interval(0.0, 0.9, 1.0)


def test_screen_and_gate_give_the_same_interval(tmp_path):
    """`mean_interval` and a gap axis give the same interval for the mean of the same values."""
    with s2rstore.open(tiny.build(tmp_path / "s.s2r", n=240)) as store:
        held_out = np.flatnonzero(run_metrics.held_out(store, "vanilla"))
        columns, trajectory = store.run_columns("vanilla"), store.instances.trajectory
        gap = columns.real.error[held_out] - columns.sim.error[held_out]
        screen = bootstrap.mean_interval(gap, trajectory[held_out])
        evidence = Evidence(store, "vanilla", np.arange(240))
        task = axis("task").measure(evidence, GapSettings())
        gate = bootstrap.percentile_interval(task.value, task.replicates)
        assert (screen.low, screen.value, screen.high) == pytest.approx(
            (gate.low, gate.value, gate.high), abs=1e-12
        )
        accuracy = columns.real.accuracy[held_out]
        blocks = bootstrap.split_into_blocks(trajectory[held_out])
        expected = bootstrap.percentile_interval(
            float(accuracy.mean()), bootstrap.mean_replicates(accuracy, blocks)
        )
        assert run_metrics.side_metrics(store, "vanilla", "real").accuracy == expected.clipped(0, 1)
