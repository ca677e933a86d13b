"""Distances, divergences and PRDC compared with references, and the samples of predictions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import wasserstein_distance

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rtools.common.blocks import split_into_blocks
from s2rtools.common.wasserstein import sliced_wasserstein, wasserstein_by_dimension
from s2rtools.gap.visual.divergence import (
    divergences,
    prediction_samples,
    principal_components,
)
from s2rtools.gap.visual.feature_distances import prdc
from s2rtools.gap.visual.split_half_metrics import split_half_metrics


@given(st.integers(0, 10_000), st.integers(1, 30), st.booleans())
def test_wasserstein_equals_scipy(seed, n, ties):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(n, 3)), rng.normal(0.5, 2, size=(n, 3))
    if ties:
        x, y = np.round(x), np.round(y)
    expected = [wasserstein_distance(x[:, k], y[:, k]) for k in range(3)]
    assert np.allclose(wasserstein_by_dimension(x, y), expected)


def test_sliced_wasserstein_is_seeded_and_measures_a_shift():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(50, 1))
    assert sliced_wasserstein(x, x + 3) == pytest.approx(3)
    x, y = rng.normal(size=(2, 50, 20))
    assert sliced_wasserstein(x, y, seed=4) == sliced_wasserstein(x, y, seed=4)
    assert sliced_wasserstein(x, y, seed=4) != sliced_wasserstein(x, y, seed=5)
    assert sliced_wasserstein(x, x) == 0


def gaussian_divergence(mean: np.ndarray, s: np.ndarray, t: np.ndarray) -> float:
    """D(N(0, s) || N(mean, t)) in nats."""
    inverse = np.linalg.inv(t)
    logs = np.linalg.slogdet(t)[1] - np.linalg.slogdet(s)[1]
    return float((np.trace(inverse @ s) + mean @ inverse @ mean - len(mean) + logs) / 2)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_divergences_equal_the_closed_form_of_gaussians(d):
    rng = np.random.default_rng(d)
    mean, a, b = np.full(d, 0.6), np.eye(d) * 1.5, np.eye(d) + 0.3
    n = 2000 if d < 3 else 20_000
    m = n // 2 if d == 1 else n
    computed = [
        divergences(rng.multivariate_normal(np.zeros(d), a, n), rng.multivariate_normal(mean, b, m))
        for _ in range(6)
    ]
    forward, backward = gaussian_divergence(mean, a, b), gaussian_divergence(-mean, b, a)
    assert np.mean([f.forward for f in computed]) == pytest.approx(forward, abs=0.05)
    assert np.mean([f.backward for f in computed]) == pytest.approx(backward, abs=0.05)


def test_divergences_of_samples_with_duplicates_are_finite():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, 2))
    duplicated = np.concatenate([x[:150], np.repeat(x[150:160], 15, axis=0)])
    computed = divergences(duplicated, rng.normal(size=(300, 2)))
    assert np.isfinite([computed.forward, computed.backward]).all()
    constant = np.ones((20, 2))
    assert divergences(constant, constant).forward == 0
    assert divergences(constant, rng.normal(size=(20, 2))).forward == np.inf
    rounded = np.round(rng.normal(size=(400, 1)), 1), np.round(rng.normal(size=(400, 1)), 1)
    assert divergences(*rounded).forward == pytest.approx(0, abs=0.15)


def test_divergences_of_angles_are_independent_of_the_origin():
    rng = np.random.default_rng(5)
    x, y = rng.normal(0, 0.4, size=(200, 2)), rng.normal(0.3, 0.6, size=(150, 2))
    periods = np.array([0.0, 2 * np.pi])
    unwrapped = divergences(x, y)
    for turn in (0.0, 1.0, np.pi):
        rotated = (points + np.array([0, turn]) for points in (x, y))
        computed = divergences(*rotated, periods=periods)
        assert computed.forward == pytest.approx(unwrapped.forward, abs=1e-6)
        assert computed.backward == pytest.approx(unwrapped.backward, abs=1e-6)
    wrapped = divergences(*(np.mod(points, [100, 2 * np.pi]) for points in (x, y)))
    assert abs(wrapped.forward - unwrapped.forward) > 0.01
    at_the_edge = np.array([[-1e-17], [2 * np.pi]] * 8) + rng.normal(0, 1e-18, (16, 1))
    assert np.isfinite(divergences(at_the_edge, rng.normal(size=(16, 1)), 2, periods[1:]).backward)


def test_divergences_reject_few_samples():
    with pytest.raises(ValueError, match="6 samples"):
        divergences(np.zeros((3, 2)), np.zeros((30, 2)))


@given(st.integers(0, 10_000), st.integers(4, 20), st.integers(4, 20))
def test_prdc_equals_brute_force(seed, n, m):
    rng = np.random.default_rng(seed)
    k = 3
    real, sim = rng.normal(size=(n, 2)), rng.normal(0.5, 1, size=(m, 2))

    def radius(points: np.ndarray, i: int) -> float:
        return sorted(np.linalg.norm(points - points[i], axis=1))[k]

    inside = np.array(
        [[np.linalg.norm(r - s) <= radius(real, i) for s in sim] for i, r in enumerate(real)]
    )
    reverse = np.array(
        [[np.linalg.norm(r - s) <= radius(sim, j) for j, s in enumerate(sim)] for r in real]
    )
    computed = prdc(real, sim, k)
    assert computed.precision == pytest.approx(inside.any(axis=0).mean())
    assert computed.recall == pytest.approx(reverse.any(axis=1).mean())
    assert computed.density == pytest.approx(inside.sum() / (k * m))
    assert computed.coverage == pytest.approx(inside.any(axis=1).mean())


def test_prdc_of_equal_and_distant_samples():
    x = np.random.default_rng(1).normal(size=(40, 300)) * 1e3
    identical, distant = prdc(x, x.copy()), prdc(x, x + 1e5)
    assert (identical.precision, identical.recall, identical.coverage) == (1, 1, 1)
    assert (distant.precision, distant.recall, distant.density, distant.coverage) == (0, 0, 0, 0)
    assert prdc(np.ones((9, 2)), np.ones((9, 2))).coverage == 1
    with pytest.raises(ValueError, match="6 samples"):
        prdc(x[:3], x)


N = 40


@pytest.fixture
def store(tiny_store: Path) -> Iterator[Store]:
    with s2rstore.open(tiny_store) as opened:
        yield opened


def test_poses_and_errors_are_standardized(store):
    samples = prediction_samples(store, "vanilla", np.arange(N))
    columns = store.run_columns("vanilla")
    poses, errors = samples["poses"], samples["errors"]
    assert poses.sim.shape == (N, 3)
    assert errors.real.shape == (N, 2)
    scale = columns.sim.x[1] / poses.sim[1, 0]
    assert np.allclose(poses.real[:, 1] * scale, columns.real.y)
    assert np.concatenate([poses.sim, poses.real])[:, :2].var(axis=0).mean() == pytest.approx(1)
    assert np.concatenate([errors.sim, errors.real]).std(axis=0) == pytest.approx(1)
    turn = poses.periods[2] / (2 * np.pi)
    assert poses.periods[:2].tolist() == [0, 0]
    assert np.allclose(poses.real[:, 2], columns.real.heading * turn)
    assert not errors.periods.any()


def test_missing_headings_are_excluded(store_copy):
    with edit(store_copy) as draft:
        key = {"run": "vanilla", "side": "sim"}
        draft.update("prediction", key, {"heading": None, "heading_error": None})
        draft.update("run", {"run": "dataaug"}, {"key": None})
    with s2rstore.open(store_copy) as store:
        samples = prediction_samples(store, "vanilla", np.arange(N))
        assert [samples[name].sim.shape[1] for name in ("poses", "errors")] == [2, 1]
        assert prediction_samples(store, "dataaug", np.arange(N)) == {}


def test_divergences_ignore_missing_rows_and_need_enough_samples(store):
    rng = np.random.default_rng(0)
    sim, real = rng.normal(size=(2, N, 6))
    blocks = split_into_blocks(np.zeros(N, np.int32))
    points = principal_components(sim, real, 2)
    assert points.sim.shape == points.real.shape == (N, 2)
    points.sim[::4] = np.nan
    result = split_half_metrics(sim, real, blocks, 1, {"some": points})
    divergence = result["kl_some_sim_real"]
    assert np.isfinite([divergence["value"], divergence["floor"]]).all()
    points.sim[5:] = np.nan
    assert "kl_some_sim_real" not in split_half_metrics(sim, real, blocks, 1, {"some": points})
