"""Outlier scores: compared with brute force, and computed alone where they are missing."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.tasks import outliers
from s2rtools.precompute.tasks.umap_projection import sample_rows
from s2rtui.session.heatmaps import heatmap_choices
from tests.conftest import BuildOnce
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

FEATURE_DISTANCE_ONLY = PrecomputeOptions(kinds=("feature_distance",))


def distances_by_brute_force(points: np.ndarray, sample: np.ndarray, count: int = 10) -> np.ndarray:
    distances = np.full(len(points), np.nan)
    for i in range(len(points)):
        others = sample[sample != i]
        if np.isfinite(points[i]).all() and others.size:
            neighbour_distances = np.sort(
                np.linalg.norm(points[others] - points[i].astype(np.float64), axis=1)
            )
            distances[i] = neighbour_distances[:count].mean()
    return distances


@pytest.mark.parametrize("n", [1, 2, 11, 12, 300])
@pytest.mark.parametrize("limit", [8, 40, 1000])
def test_distances_equal_brute_force(n, limit):
    rng = np.random.default_rng(n)
    points = rng.normal(size=(n, 6)).astype(np.float32)
    points[7::9] = points[0]  # equal embeddings have distance 0
    points[5::11] = np.nan
    settings = outliers.OutlierSettings(sample=limit)
    sample = sample_rows(np.isfinite(points[:, 0]), limit, settings.seed)
    assert sample.size <= limit
    distances = outliers.neighbour_distance(
        points, np.arange(n), points[sample], sample, settings=settings
    )
    assert np.allclose(
        distances, distances_by_brute_force(points, sample), atol=1e-5, equal_nan=True
    )


def test_scores_are_multiples_of_the_median():
    scores = outliers.outlier_scores(np.array([1, 2, 4, np.nan, 6, 2], np.float32))
    assert np.array_equal(scores, [0.5, 1, 2, np.nan, 3, 1], equal_nan=True)
    for without_scores in (np.zeros(4), np.full(3, np.nan), np.empty(0)):
        assert np.isnan(outliers.outlier_scores(without_scores.astype(np.float32))).all()


def test_equal_embeddings_have_no_outliers():
    rng = np.random.default_rng(0)
    points = np.float32(900) * (1 + rng.normal(size=(60, 4)).astype(np.float32) * 1e-8)
    distances = outliers.neighbour_distance(points, np.arange(60), points, np.arange(60))
    assert np.isnan(outliers.outlier_scores(distances)).all()


@pytest.fixture(scope="module")
def computed(trained_store: Path, build_once: BuildOnce) -> Path:
    def compute(path: Path) -> None:
        copy_store(trained_store, path)
        assert precompute(path, SilentReporter(), ["vanilla"], FEATURE_DISTANCE_ONLY)

    return build_once("outliers.s2r", compute)


def test_the_index_contains_the_outlier_scores(computed):
    with s2rstore.open(computed) as store:
        for side in ("sim", "real"):
            points = np.asarray(store.array("vanilla", "pca", side)[1][:])
            neighbour_distances = distances_by_brute_force(points, np.arange(len(points)))
            scores = store.run_columns("vanilla").side(side).outlier
            assert np.allclose(
                scores, neighbour_distances / np.median(neighbour_distances), rtol=1e-4
            )
        stored_row = store.execute("SELECT max(abs(sim_outlier)), count(real_outlier) FROM pair")[0]
        assert stored_row[0] == pytest.approx(store.run_columns("vanilla").sim.outlier.max())
        assert stored_row[1] == len(store.instances)
        assert heatmap_choices(store, "vanilla") == [("feature_distance", None)]


@pytest.mark.parametrize("rows", [outliers.OUTLIER_ROWS, 32])
def test_only_missing_scores_are_computed(computed, tmp_path, monkeypatch, rows):
    """In one work unit or in several."""
    monkeypatch.setattr(outliers, "OUTLIER_ROWS", rows)
    path = copy_store(computed, tmp_path / "s.s2r")
    with s2rstore.open(path) as store:
        before = store.execute("SELECT * FROM pair ORDER BY iid")
        arrays = {record.path for record in store.array_kinds("vanilla")}
    for folder in path.glob(f"runs.zarr/*/*/{outliers.KIND}.*"):
        shutil.rmtree(folder)
    with edit(path) as draft:
        draft.delete("zarr_array", kind=outliers.KIND)
        draft._connection.execute("UPDATE prediction SET outlier = NULL")
    written = {p: p.stat().st_mtime_ns for p in (path / "runs.zarr").rglob("*") if p.is_file()}
    reporter = SilentReporter()
    assert precompute(path, reporter, ["vanilla"], FEATURE_DISTANCE_ONLY) == ["vanilla"]
    assert reporter.steps == 40
    assert {p: p.stat().st_mtime_ns for p in written} == written
    with s2rstore.open(path) as store:
        assert store.execute("SELECT * FROM pair ORDER BY iid") == before
        assert {record.path for record in store.array_kinds("vanilla")} == arrays
    assert verify(path) == []
    assert precompute(path, reporter, ["vanilla"], FEATURE_DISTANCE_ONLY) == []
