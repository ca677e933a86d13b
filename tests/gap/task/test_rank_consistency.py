"""Agreement of the run rankings in sim and real, compared with scipy and brute force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kendalltau, pearsonr, spearmanr

import s2rstore
from s2rstore.errors import InconclusiveError
from s2rtools.gap.axis import GapSettings
from s2rtools.gap.task.rank_consistency import rank_consistency, rank_violation, regret
from tests.support import tiny

N = 600


@given(st.integers(0, 10_000), st.integers(3, 9))
def test_the_rank_violation_of_equal_instances_is_that_of_the_definition(seed, runs) -> None:
    sim, real = np.random.default_rng(seed).gamma(2, 1, size=(2, runs))
    pairs = [[(sim[i] < sim[j]) != (real[i] < real[j]) for j in range(runs)] for i in range(runs)]
    worst = [
        max(abs(real[i] - real[j]) * pairs[i][j] for j in range(runs) if j != i)
        for i in range(runs)
    ]
    found = rank_violation(*(np.tile(each, (7, 1)) for each in (sim, real)))
    assert found == pytest.approx(np.mean(worst))


def test_noise_does_not_make_the_rank_violation_larger() -> None:
    """The runs are equally good, so that every violation is noise."""
    rng = np.random.default_rng(1)
    found = [rank_violation(*rng.gamma(2, 1, size=(2, 50, 6))) for _ in range(300)]
    assert abs(np.mean(found)) < 4 * np.std(found) / np.sqrt(len(found))


def test_five_runs_are_compared_with_intervals(tmp_path: Path) -> None:
    root = tiny.build(tmp_path / "s.s2r", N, tuple("abcde"), trained=tuple("abcde"))
    with s2rstore.open(root) as store:
        result = rank_consistency(store, np.arange(N), GapSettings())
        repeated = rank_consistency(store, np.arange(N), GapSettings())
        with pytest.raises(InconclusiveError, match="3 instances"):
            rank_consistency(store, np.array([4, 9, 14]), GapSettings())
        held_out = np.arange(N) % 5 == 4
        real = [store.run_columns(run).real.error[held_out].mean() for run in result.runs]
    assert result == repeated
    assert result.runs == tuple("abcde")
    assert result.n == N // 5
    assert result.real == pytest.approx(real)
    for figure, reference in (
        (result.pearson, pearsonr), (result.kendall, kendalltau), (result.spearman.value, spearmanr)
    ):  # fmt: skip
        assert figure == pytest.approx(reference(result.sim, result.real).statistic)
    assert not result.spearman.is_known
    assert result.scope == "these runs only"
    chosen, best = result.runs.index(result.chosen), result.runs.index(result.best)
    assert (result.sim[chosen], result.real[best]) == (min(result.sim), min(result.real))
    assert result.regret.value == pytest.approx(result.real[chosen] - result.real[best])
    assert 0 <= result.regret.low <= result.regret.value <= result.regret.high
    assert sum(room.n for room in result.rooms.values()) == result.n
    room = result.rooms["right"]
    assert room.as_json()["regret"] == pytest.approx(
        room.real[room.runs.index(room.chosen)] - min(room.real)
    )


def test_the_regret_of_the_best_run_may_be_0_and_of_a_bad_one_is_not() -> None:
    rng = np.random.default_rng(0)
    real = (
        rng.gamma(2, 1, size=(100, 1)) + np.array([0.0, 0.01, 1.0]) + rng.normal(0, 0.1, (100, 3))
    )
    trajectory = np.zeros(100, dtype=np.intp)
    best, bad = (regret(real, chosen, trajectory, 0.95) for chosen in (0, 2))
    assert best.low == best.value == 0
    assert 0.9 < bad.low < bad.value < bad.high < 1.1


def test_fewer_than_five_runs_are_inconclusive(tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store, pytest.raises(InconclusiveError, match="2 computed"):
        rank_consistency(store, np.arange(40), GapSettings())
