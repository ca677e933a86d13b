"""Predictions as low-dimensional samples: scaling, circular headings and missing values."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rtools.common.blocks import split_into_blocks
from s2rtools.gap.visual.low_dimensional_samples import prediction_samples, principal_components
from s2rtools.gap.visual.split_half_metrics import split_half_metrics

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
