"""Agreement of the run rankings in sim and real, compared with scipy and brute force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import pearsonr

import s2rstore
from s2rstore.errors import InconclusiveError
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.task.rank_consistency import correlation, rank_consistency, rank_violation
from tests.support import tiny

N = 120


def brute_violation(sim: np.ndarray, real: np.ndarray) -> float:
    count = len(sim)
    is_swapped = [
        [(sim[i] < sim[j]) != (real[i] < real[j]) for j in range(count)] for i in range(count)
    ]
    worst = [
        max(abs(real[i] - real[j]) if is_swapped[i][j] else 0.0 for j in range(count))
        for i in range(count)
    ]
    return float(np.mean(worst))


@given(st.integers(0, 10_000), st.integers(3, 9), st.booleans())
def test_both_measures_equal_their_definitions(seed: int, runs: int, ties: bool) -> None:
    rng = np.random.default_rng(seed)
    sim, real = rng.gamma(2, 1, size=(2, runs))
    if ties:
        sim, real = np.round(sim), np.round(real)
    assert rank_violation(sim[None], real[None])[0] == pytest.approx(brute_violation(sim, real))
    result = correlation(sim[None], real[None])[0]
    if np.ptp(sim) and np.ptp(real):
        assert result == pytest.approx(pearsonr(sim, real).statistic)
    else:
        assert np.isnan(result)


@given(st.integers(0, 10_000), st.integers(5, 9))
def test_rank_violation_is_0_for_equal_and_largest_for_reversed_order(seed: int, runs: int) -> None:
    real = np.sort(np.random.default_rng(seed).gamma(2, 1, size=runs))[None]
    assert rank_violation(real**3, real)[0] == 0
    reverse = rank_violation(-real, real)[0]
    for other in range(5):
        shuffled = np.random.default_rng(other).permuted(real, axis=1)
        assert rank_violation(shuffled, real)[0] <= reverse + 1e-12


def test_five_runs_are_compared_with_intervals(tmp_path: Path) -> None:
    root = tiny.build(tmp_path / "s.s2r", N, tuple("abcde"), trained=tuple("abcde"))
    with s2rstore.open(root) as store:
        result = rank_consistency(store, np.arange(N), GapSettings(300))
        repeated = rank_consistency(store, np.arange(N), GapSettings(300))
        with pytest.raises(InconclusiveError, match="3 instances"):
            rank_consistency(store, np.array([4, 9, 14]), GapSettings())
        held_out = np.arange(N) % 5 == 4
        real = [store.run_columns(run).real.error[held_out].mean() for run in result.runs]
    assert result == repeated
    assert result.runs == tuple("abcde")
    assert result.n == N // 5
    assert result.real == pytest.approx(real)
    assert result.correlation.value == pytest.approx(pearsonr(result.sim, result.real).statistic)
    assert -1 <= result.correlation.low <= result.correlation.value <= result.correlation.high <= 1
    assert 0 <= result.rank_violation.low <= result.rank_violation.high


def test_fewer_than_five_runs_are_inconclusive(tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store, pytest.raises(InconclusiveError, match="2 computed"):
        rank_consistency(store, np.arange(40), GapSettings())
