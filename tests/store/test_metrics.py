"""Ranks, accuracies and intervals compared with independent computations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import s2rstore
from s2rstore.geometry import angles
from s2rstore.index.transaction import edit
from s2rstore.metrics import pose_metrics, run_metrics
from tests.conftest import BuildOnce
from tests.support import tiny
from tests.support.copies import copy_store


@pytest.fixture(scope="module")
def trained_tiny(build_once: BuildOnce) -> Path:
    """The synthetic store with runs that were trained on four of five instances."""
    return build_once("trained-tiny.s2r", lambda path: tiny.build(path, trained=tiny.RUNS))


@given(st.floats(-1e4, 1e4))
def test_wrap_keeps_the_direction(angle):
    wrapped = float(angles.wrap(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.isclose(np.cos(wrapped), np.cos(angle), atol=1e-6)
    assert np.isclose(np.sin(wrapped), np.sin(angle), atol=1e-6)


@given(st.floats(-7, 7))
def test_habitat_yaw_gives_the_documented_forward(r):
    heading = float(angles.from_habitat(r))
    assert np.allclose([np.cos(heading), np.sin(heading)], [-np.sin(r), -np.cos(r)], atol=1e-9)


@given(
    hnp.arrays(np.float64, st.integers(0, 40), elements=st.sampled_from([0.0, 1.0, 2.5, np.nan]))
)
def test_ranks_order_by_error_then_index(error):
    known_rows = [i for i in range(error.size) if not np.isnan(error[i])]
    expected = np.zeros(error.size, int)
    for position, index in enumerate(sorted(known_rows, key=lambda i: (error[i], i))):
        expected[index] = position + 1
    assert (pose_metrics.rank(error) == expected).all()


def test_the_loss_is_the_weighted_sum_of_the_paper():
    loss = pose_metrics.pose_loss(np.array([2.0]), np.array([0.5]))
    assert np.allclose(loss, 0.7 * 4 + 0.3 * 0.5)


def test_metrics_exclude_training_instances(trained_tiny):
    with s2rstore.open(trained_tiny) as store:
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


def test_the_baseline_is_measured_from_the_poses_of_the_images_of_a_side(trained_tiny, tmp_path):
    path = copy_store(trained_tiny, tmp_path / "s.s2r")
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
