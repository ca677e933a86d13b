"""Scores of estimates of harm, on made-up gains with known answers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import spearmanr
from sklearn.metrics import roc_auc_score

from s2rtools.scoring.harm_metrics import (
    HARMFUL,
    ScoredPairs,
    harm_score,
    pool_runs,
    pool_stores,
    weighted_auroc,
    weighted_correlation,
)

VIEWS = 120


def made_pairs(seed: int = 1, in_metres: bool = False) -> ScoredPairs:
    """Three pairs in each of 120 views, with estimates that are the gains themselves."""
    gain = np.random.default_rng(seed).normal(0.1, 0.6, 3 * VIEWS)
    view = np.repeat(np.arange(VIEWS), 3)
    return ScoredPairs(gain, gain.copy(), view, np.arange(VIEWS) // 60, in_metres)


def with_estimate(pairs: ScoredPairs, estimate: np.ndarray) -> ScoredPairs:
    return ScoredPairs(pairs.gain, estimate, pairs.view, pairs.trajectory, pairs.in_metres)


def test_a_perfect_estimate_scores_one():
    pairs = made_pairs(in_metres=True)
    score = harm_score(pairs)
    assert (score.correlation.value, score.auroc.value) == (pytest.approx(1), pytest.approx(1))
    assert score.auroc.reason == "all values are equal"
    harmful = pairs.gain > HARMFUL
    assert score.claims == harmful.sum()
    assert score.precision.value == 1
    assert score.delivered.value == pytest.approx(pairs.gain[harmful].mean())
    assert score.base_rate == pytest.approx(harmful.mean())
    assert score.mean_gain == pytest.approx(pairs.gain.mean())
    assert (score.n, score.views) == (3 * VIEWS, VIEWS)


def test_a_random_estimate_scores_one_half():
    pairs = made_pairs(in_metres=True)
    scores = [
        harm_score(
            with_estimate(pairs, np.random.default_rng(100 + seed).normal(0, 1, pairs.gain.size))
        )
        for seed in range(20)
    ]
    assert np.mean([score.auroc.value for score in scores]) == pytest.approx(0.5, abs=0.03)
    assert np.mean([score.correlation.value for score in scores]) == pytest.approx(0, abs=0.05)
    precision = np.mean([score.precision.value for score in scores])
    assert precision == pytest.approx(scores[0].base_rate, abs=0.04)
    covered = [score.auroc.low <= 0.5 <= score.auroc.high for score in scores]
    assert np.mean(covered) > 0.75


def test_a_constant_estimate_ranks_nothing():
    pairs = made_pairs()
    score = harm_score(with_estimate(pairs, np.full(pairs.gain.size, 3.0)))
    assert score.auroc.value == 0.5
    assert np.isnan(score.correlation.value)
    assert score.claims == 0, "estimates that are not in metres claim nothing"


def test_an_unknown_estimate_ranks_in_the_middle_and_claims_nothing():
    pairs = made_pairs(in_metres=True)
    score = harm_score(with_estimate(pairs, np.full(pairs.gain.size, np.nan)))
    assert (score.auroc.value, score.claims) == (0.5, 0)
    half = np.where(np.arange(pairs.gain.size) % 2, pairs.gain, np.nan)
    assert 0.6 < harm_score(with_estimate(pairs, half)).auroc.value < 0.95


def test_few_harmful_pairs_have_no_interval():
    pairs = made_pairs()
    gain = np.where(np.arange(pairs.gain.size) < 3, 1.0, -1.0)
    score = harm_score(ScoredPairs(gain, gain, pairs.view, pairs.trajectory))
    assert score.auroc.value == 1
    assert np.isnan(score.auroc.low)


def test_without_pairs_the_score_is_undefined():
    empty = np.zeros(0)
    score = harm_score(ScoredPairs(empty, empty, np.zeros(0, int), np.zeros(5, int), True))
    assert (score.n, score.claims) == (0, 0)
    assert np.isnan([score.auroc.value, score.correlation.value, score.base_rate]).all()


@given(st.integers(0, 10_000), st.integers(6, 40))
def test_weights_count_like_repeated_rows(seed, n):
    """As sklearn and scipy score the rows, each repeated as often as its weight says."""
    rng = np.random.default_rng(seed)
    a, b = rng.integers(0, 6, n).astype(float), rng.integers(0, 6, n).astype(float)
    weights = rng.integers(0, 4, n)
    codes = [np.unique(values, return_inverse=True)[1] for values in (a, b)]
    repeated = np.repeat(np.arange(n), weights)
    x, y, positive = a[repeated], b[repeated], a > 2
    auroc = weighted_auroc(positive, codes[1], weights.astype(float))
    if len(set(positive[repeated])) == 2:
        assert auroc == pytest.approx(roc_auc_score(positive[repeated], y))
    else:
        assert np.isnan(auroc)
    correlation = weighted_correlation(codes[0], codes[1], weights.astype(float))
    if len(set(x)) > 1 and len(set(y)) > 1:
        assert correlation == pytest.approx(spearmanr(x, y).statistic)
    else:
        assert np.isnan(correlation)


def test_runs_are_pooled_on_a_common_scale():
    """A network whose heat is a thousand times larger does not drown the others."""
    first, second = made_pairs(1), made_pairs(2)
    large = with_estimate(second, second.gain * 1000)
    assert harm_score(pool_runs([first, large])).auroc.value > 0.99
    assert pool_runs([first, large]).trajectory.size == VIEWS


def test_views_of_several_stores_stay_apart():
    first, second = made_pairs(1), made_pairs(2)
    pooled = pool_stores([first, second])
    assert pooled.trajectory.tolist() == [*first.trajectory, *(second.trajectory + 2)]
    assert harm_score(pooled).views == 2 * VIEWS
