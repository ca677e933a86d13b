"""Ranking metrics compared with sklearn, and the common grid compared with brute force."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import roc_auc_score

from s2rtools.scoring.ground_truth import IMAGE_CELLS, to_cells
from s2rtools.scoring.heatmap_metrics import TILE, score_heatmaps
from s2rtools.scoring.statistics import RankedCells


@given(st.integers(0, 10_000), st.integers(4, 60))
def test_auroc_equals_sklearn(seed, n):
    rng = np.random.default_rng(seed)
    values, positive = rng.random(n), rng.random(n) < 0.4
    ranked = RankedCells.of(values, positive, np.random.default_rng(0))
    if positive.all() or not positive.any():
        assert np.isnan(ranked.auroc())
        return
    assert ranked.auroc() == pytest.approx(roc_auc_score(positive, values))
    weights = rng.integers(0, 4, n).astype(float)
    if (weights * positive).sum() and (weights * ~positive).sum():
        expected = roc_auc_score(positive, values, sample_weight=weights)
        assert ranked.auroc(weights) == pytest.approx(expected)


def test_ties_are_broken_randomly_by_the_seed():
    positive = np.arange(400) < 100
    constant = np.zeros(400)
    scores = [
        RankedCells.of(constant, positive, np.random.default_rng(s)).auroc() for s in range(200)
    ]
    assert np.mean(scores) == pytest.approx(0.5, abs=0.01)
    repeated = RankedCells.of(constant, positive, np.random.default_rng(7)).auroc()
    assert repeated == scores[7]


def test_missing_values_are_ranked_randomly():
    values = np.array([np.nan, -5.0, 0.0, 3.0, np.nan])
    high = RankedCells.of(values, np.array([0, 0, 0, 1, 0], bool), np.random.default_rng(0))
    low = RankedCells.of(values, np.array([0, 1, 0, 0, 0], bool), np.random.default_rng(0))
    assert (high.auroc(), low.auroc()) == (1.0, 0.0)
    all_missing = np.full(400, np.nan)
    scores = [
        RankedCells.of(all_missing, np.arange(400) < 90, np.random.default_rng(s)).auroc()
        for s in range(100)
    ]
    assert np.mean(scores) == pytest.approx(0.5, abs=0.02)


def test_precision_counts_the_top_share():
    values = np.arange(100.0)
    positive = np.zeros(100, dtype=bool)
    positive[[99, 97, 10]] = True
    ranked = RankedCells.of(values, positive, np.random.default_rng(0))
    assert ranked.precision(0.05) == pytest.approx(0.4)
    assert ranked.precision(0.015) == pytest.approx(1 / 1.5)


@pytest.mark.parametrize("size", [(6, 6), (16, 16), (32, 32), (128, 128), (48, 64)])
def test_the_common_grid_keeps_the_mean(size):
    heat = np.random.default_rng(1).random((3, *size)).astype(np.float32)
    cells = to_cells(heat)
    assert cells.shape == (3, IMAGE_CELLS, IMAGE_CELLS)
    assert np.allclose(cells.mean(axis=(1, 2)), heat.mean(axis=(1, 2)), atol=1e-5)
    half_missing = heat.copy()
    half_missing[:, : size[0] // 2] = np.nan
    assert np.isnan(to_cells(half_missing)[:, : IMAGE_CELLS // 2 - 1]).all()
    assert np.isfinite(to_cells(half_missing)[:, IMAGE_CELLS // 2 + 1 :]).all()


def test_floor_intervals_of_few_tiles_hold_their_level():
    """A random map has AUROC 0.5; percentiles without correction cover it in 80 % with 4 tiles."""
    rng = np.random.default_rng(5)
    covered = 0
    for seed in range(60):
        shape = (2 * TILE, 2 * TILE)
        hits = 9.0 * (rng.random(shape) < 0.3)
        seen = SimpleNamespace(
            cells=np.zeros((0, 4, 4), bool), samples=np.full(shape, 9.0), hits=hits
        )
        store = SimpleNamespace(
            in_recording_order=np.flatnonzero,
            instances=SimpleNamespace(trajectory=np.zeros(0, int)),
        )
        truth = SimpleNamespace(visible_objects=lambda *_, seen=seen: seen, store=store)
        floor = score_heatmaps(truth, [], seed)[1]
        assert 0 <= floor.auroc.low <= floor.auroc.high <= 1
        covered += floor.auroc.low <= 0.5 <= floor.auroc.high
    assert covered >= 54
