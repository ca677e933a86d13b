"""Ranks, accuracies and intervals against a second way of computing them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import s2rstore
from s2rstore.geometry import angles
from s2rstore.metrics import bootstrap, pose_metrics, run_metrics, store_summary
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
    known = [i for i in range(error.size) if not np.isnan(error[i])]
    wanted = np.zeros(error.size, int)
    for position, index in enumerate(sorted(known, key=lambda i: (error[i], i))):
        wanted[index] = position + 1
    assert (pose_metrics.rank(error) == wanted).all()


def test_the_loss_is_the_papers() -> None:
    loss = pose_metrics.pose_loss(np.array([2.0]), np.array([0.5]))
    assert np.allclose(loss, 0.7 * 4 + 0.3 * 0.5)


def test_the_interval_covers_the_mean_of_independent_values_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(200):
        found = bootstrap.mean_interval(
            rng.normal(1, 1, 200), settings=bootstrap.BootstrapSettings(400, block_length=5)
        )
        hits += found.low <= 1 <= found.high
    assert 175 <= hits <= 199


def test_neighbouring_values_that_repeat_widen_the_interval() -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(0, 1, 40)
    single = bootstrap.mean_interval(np.tile(values, 1).repeat(1))
    repeated = bootstrap.mean_interval(values.repeat(10))
    naive = bootstrap.mean_interval(
        values.repeat(10), settings=bootstrap.BootstrapSettings(block_length=1)
    )
    assert repeated.high - repeated.low > 2 * (naive.high - naive.low)
    assert single.low < single.value < single.high


def test_headlines_leave_out_what_the_model_was_trained_on(tiny_store) -> None:
    with s2rstore.open(tiny_store) as store:
        columns = store.run_columns("vanilla")
        found = run_metrics.headline(store, "vanilla", "sim")
        keep = np.arange(40) % 5 == 4
        assert (found.n, found.trained_on) == (8, 32)
        assert np.isclose(found.accuracy.value, columns.sim.accuracy[keep].mean())
        real = run_metrics.headline(store, "vanilla", "real")
        assert (real.n, real.trained_on) == (8, 32)
        assert np.isclose(real.median_error, np.median(columns.real.error[keep]))
        x, y = store.instances.x[keep], store.instances.y[keep]
        off = np.hypot(x - x.mean(), y - y.mean())
        assert np.isclose(
            run_metrics.baseline(store, "vanilla"), np.maximum(0, 1 - off / 12).mean()
        )


def test_findings_name_the_worst_room(tmp_path) -> None:
    with s2rstore.open(tiny.build(tmp_path / "s.s2r", n=120)) as store:
        found = store_summary.regions(store, "vanilla")
        medians = store.execute(
            """SELECT room, median(real_error), count(*) FROM pair
               WHERE run = 'vanilla' AND sim_split = 'test' AND room IS NOT NULL GROUP BY room
               HAVING count(*) >= 5 ORDER BY 2 DESC"""
        )
        assert [(r.room, r.n) for r in found] == [(room, n) for room, _, n in medians]
        assert np.isclose(found[0].real_median, medians[0][1])
        assert any(found[0].room in line for line in store_summary.lines(store))
