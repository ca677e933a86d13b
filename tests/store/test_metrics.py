"""Ranks, accuracies and intervals compared with independent computations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

import s2rstore
from s2rstore.findings import store_summary, worst_room
from s2rstore.geometry import angles
from s2rstore.index.transaction import edit
from s2rstore.metrics import bootstrap, median_intervals, pose_metrics, run_metrics
from tests.support import tiny


@given(st.floats(-1e4, 1e4))
def test_wrap_keeps_the_direction(angle: float) -> None:
    wrapped = float(angles.wrap(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.isclose(np.cos(wrapped), np.cos(angle), atol=1e-6)
    assert np.isclose(np.sin(wrapped), np.sin(angle), atol=1e-6)


@given(st.floats(-7, 7))
def test_habitat_yaw_gives_the_documented_forward(r: float) -> None:
    heading = float(angles.from_habitat(r))
    assert np.allclose([np.cos(heading), np.sin(heading)], [-np.sin(r), -np.cos(r)], atol=1e-9)


@settings(deadline=None)
@given(
    hnp.arrays(np.float64, st.integers(0, 40), elements=st.sampled_from([0.0, 1.0, 2.5, np.nan]))
)
def test_ranks_order_by_error_then_index(error: np.ndarray) -> None:
    known_rows = [i for i in range(error.size) if not np.isnan(error[i])]
    expected = np.zeros(error.size, int)
    for position, index in enumerate(sorted(known_rows, key=lambda i: (error[i], i))):
        expected[index] = position + 1
    assert (pose_metrics.rank(error) == expected).all()


def test_the_loss_is_the_weighted_sum_of_the_paper() -> None:
    loss = pose_metrics.pose_loss(np.array([2.0]), np.array([0.5]))
    assert np.allclose(loss, 0.7 * 4 + 0.3 * 0.5)


def test_the_interval_of_independent_values_has_the_nominal_coverage() -> None:
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(200):
        result = bootstrap.mean_interval(
            rng.normal(1, 1, 200), settings=bootstrap.BootstrapSettings(400, block_length=5)
        )
        hits += result.low <= 1 <= result.high
    assert 175 <= hits <= 199


def test_repeated_neighbouring_values_widen_the_interval() -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(0, 1, 40)
    single = bootstrap.mean_interval(np.tile(values, 1).repeat(1))
    repeated = bootstrap.mean_interval(values.repeat(10))
    naive = bootstrap.mean_interval(
        values.repeat(10), settings=bootstrap.BootstrapSettings(block_length=1)
    )
    assert repeated.high - repeated.low > 2 * (naive.high - naive.low)
    assert single.low < single.value < single.high


def test_metrics_exclude_training_instances(tmp_path) -> None:
    with s2rstore.open(tiny.build(tmp_path / "s.s2r", trained=tiny.RUNS)) as store:
        columns = store.run_columns("vanilla")
        result = run_metrics.side_metrics(store, "vanilla", "sim")
        held_out = np.arange(40) % 5 == 4
        assert (result.n, result.trained_on) == (8, 32)
        assert np.isclose(result.accuracy.value, columns.sim.accuracy[held_out].mean())
        real = run_metrics.side_metrics(store, "vanilla", "real")
        assert (real.n, real.trained_on) == (8, 32)
        assert np.isclose(real.median_error, np.median(columns.real.error[held_out]))
        x, y = store.instances.x[held_out], store.instances.y[held_out]
        distance = np.hypot(x - x.mean(), y - y.mean())
        assert np.isclose(
            run_metrics.baseline_accuracy(store, "vanilla"), np.maximum(0, 1 - distance / 12).mean()
        )


def test_the_summary_names_the_worst_room(tmp_path) -> None:
    with s2rstore.open(tiny.build(tmp_path / "s.s2r", n=120, trained=tiny.RUNS)) as store:
        worst = worst_room(store, "vanilla")
        medians = store.execute(
            """SELECT room, median(real_error), count(*) FROM pair
               WHERE run = 'vanilla' AND sim_split = 'test' AND room IS NOT NULL GROUP BY room
               HAVING count(*) >= 5 ORDER BY 2 DESC"""
        )
        assert worst is not None
        assert (worst.values["room"], worst.n) == (medians[0][0], medians[0][2])
        assert np.isclose(worst.values["median_real_error_m"], medians[0][1])
        lines = store_summary.summary_lines(store)
        assert any(line == f"worst room of vanilla: {worst.line}" for line in lines)


def test_the_baseline_is_measured_from_the_poses_of_the_images_of_a_side(tmp_path) -> None:
    path = tiny.build(tmp_path / "s.s2r", trained=tiny.RUNS)
    with s2rstore.open(path) as store:
        truth = store.instances
        x, y, heading = truth.x / 2, truth.y.copy(), truth.heading.copy()
        before = run_metrics.baseline_accuracy(store, "vanilla", side="real")
    own = {"iid": np.arange(40), "domain": ["sim"] * 40, "x": x, "y": y, "heading": heading}
    with edit(path) as draft:
        draft.insert("frame_pose", own)
    with s2rstore.open(path) as store:
        held_out = np.arange(40) % 5 == 4
        distance = np.hypot(*(part[held_out] - part[held_out].mean() for part in (x, y)))
        expected = np.maximum(0, 1 - distance / 12).mean()
        assert np.isclose(run_metrics.baseline_accuracy(store, "vanilla"), expected)
        assert np.isclose(run_metrics.baseline_accuracy(store, "vanilla", side="real"), before)
        assert expected > before


def _naive_median_interval(values: np.ndarray, trajectory: np.ndarray) -> tuple[float, float]:
    """Percentiles of medians of resampled blocks, block by block."""
    blocks = bootstrap.split_into_blocks(trajectory)
    counts = bootstrap.block_counts(blocks)
    pieces = np.split(values, blocks.start[1:-1])
    medians = []
    for row in counts:
        drawn = [np.tile(piece, int(k)) for piece, k in zip(pieces, row, strict=True)]
        medians.append(np.median(np.concatenate(drawn)))
    factor = float(bootstrap.correction_factor(blocks.unit_count))
    middle = float(np.median(values))
    low, high = np.percentile(medians, [2.5, 97.5])
    return middle + (low - middle) * factor, middle + (high - middle) * factor


@pytest.mark.parametrize(("n", "trajectories"), [(16, 1), (60, 2), (200, 8), (512, 3)])
def test_the_interval_of_a_median_is_that_of_resampled_blocks_or_wider(
    n: int, trajectories: int
) -> None:
    values = np.random.default_rng(n).gamma(2, 1, n).round(2)
    trajectory = np.arange(n) * trajectories // n
    interval = median_intervals.median_interval(values, trajectory)
    low, high = _naive_median_interval(values, trajectory)
    place = int(stats.binom.ppf(0.025, n, 0.5))  # P(X < place) <= 0.025
    ordered = np.sort(values)
    assert interval.value == np.median(values)
    ranks = [np.searchsorted(ordered, bound) / n for bound in (interval.low, interval.high)]
    expected = min(low, ordered[place - 1]), max(high, ordered[-place])
    exact = [np.searchsorted(ordered, bound) / n for bound in expected]
    assert ranks == pytest.approx(exact, abs=1.5 / n + 0.005)


def test_a_median_of_few_values_has_no_interval() -> None:
    few = median_intervals.median_interval(np.arange(5.0))
    assert (few.value, np.isnan(few.low), np.isnan(few.high)) == (2.0, True, True)
    one = median_intervals.median_interval(np.array([3.0]))
    assert (one.value, np.isnan(one.low), np.isnan(one.high)) == (3.0, True, True)
    assert np.isnan(median_intervals.median_interval(np.array([])).value)
