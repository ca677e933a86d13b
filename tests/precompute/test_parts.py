"""Precompute of a data set of several segments, each with arrays of its own."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import NotComputedError, RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rstore.metrics.nearest_neighbours import neighbours
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import Scan, ScanOptions
from s2rtools.precompute import pipeline, publish_results, run_stages
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.tasks import umap_projection
from tests.conftest import BuildOnce
from tests.precompute.test_appended_instances import add_run, ingest, part_of
from tests.support import pairs
from tests.support.copies import copy_store
from tests.support.plain_maps import plain_map_grid
from tests.support.silent_reporter import SilentReporter

KINDS = ("activation", "pixel_difference")
FIRST = 24
"""Instances of the first part."""


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Scan:
    """A data set of 40 pairs of one trajectory."""
    root = tmp_path_factory.mktemp("data")
    options = ScanOptions(header=pairs.sim2realviz(root, n=40), frame=(64, 64))
    return IMPORTERS["sim2realviz"](root, options)


def ingest_parts(scan: Scan, path: Path, *stops: int) -> Path:
    """A store of the instances up to each stop, ingested one after the other, and a run of them."""
    for stop in stops:
        ingest(part_of(scan, {"traj1": stop}, SIDES), path)
    add_run(path, "vanilla", "sim")
    return path


def withdraw_later_arrays(path: Path, condition: str) -> None:
    """Remove the arrays of later parts that meet an SQL condition from the index."""
    with edit(path) as draft:
        query = f"SELECT path FROM zarr_array WHERE first_iid > 0 AND {condition}"
        for (name,) in draft.rows(query):
            draft.delete("zarr_array", path=name)


@pytest.fixture(autouse=True, scope="module")
def unmerged_parts() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_stages, "segments", list)
        yield


@pytest.fixture(scope="module")
def whole(scan: Scan, build_once: BuildOnce) -> Path:
    """A computed store of one part."""

    def compute(path: Path) -> None:
        ingest_parts(scan, path, 40)
        precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS))

    return build_once("whole.s2r", compute)


@pytest.fixture(scope="module")
def parted(scan: Scan, build_once: BuildOnce) -> Path:
    """A computed store of two parts, whose projection is fitted on the first one."""

    def compute(path: Path) -> None:
        ingest_parts(scan, path, FIRST, 40)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(run_stages, "_fitted", lambda *arguments: FIRST)
            precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS))

    return build_once("parted.s2r", compute)


def values(store: Store, kind: str, side: str | None, mode: str | None = None) -> np.ndarray:
    return np.asarray(store.array("vanilla", kind, side, mode)[1])


def test_map_grids_of_parts_are_merged(whole, parted):
    with s2rstore.open(whole) as one, s2rstore.open(parted) as two:
        for aggregate in ("mean", "max", "sum", "count"):
            expected = one.map_grid("vanilla", "pixel_difference", "real", aggregate=aggregate)
            merged = two.map_grid("vanilla", "pixel_difference", "real", aggregate=aggregate)
            np.testing.assert_allclose(merged, expected, rtol=1e-5, atol=1e-6)
        with pytest.raises(RequestError, match="read it by `map_grid`"):
            two.array("vanilla", "map:pixel_difference", "real", "rgb")


@pytest.mark.parametrize("mode", ["x", "loss"])
def test_map_grids_of_modes_in_one_array_equal_a_plain_computation(whole, mode):
    with s2rstore.open(whole) as store:
        plain = plain_map_grid(store, "vanilla", "activation", "real", mode)
        for aggregate, expected in plain.items():
            grid = store.map_grid("vanilla", "activation", "real", mode, aggregate)
            np.testing.assert_allclose(grid, expected, rtol=1e-5, atol=1e-5)


def test_a_further_precompute_keeps_the_projection_unless_it_is_fitted_again(
    parted, whole, tmp_path
):
    path = copy_store(parted, tmp_path / "s.s2r")
    with s2rstore.open(path) as store:
        before = values(store, "umap", "sim")
    assert precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS)) == []
    options = PrecomputeOptions(KINDS, refit=True)
    assert precompute(path, SilentReporter(), ["vanilla"], options) == ["vanilla"]
    with s2rstore.open(path) as store, s2rstore.open(whole) as one:
        assert not np.array_equal(values(store, "umap", "sim"), before)
        for side in SIDES:
            np.testing.assert_allclose(
                np.abs(values(store, "pca", side)), np.abs(values(one, "pca", side)), atol=1e-2
            )
    assert precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS)) == []
    assert verify(path) == []


def test_a_fit_that_cannot_be_repeated_is_refused(parted, tmp_path):
    path = copy_store(parted, tmp_path / "s.s2r")
    later = [
        array.path
        for array in Store(path).array_parts("vanilla")
        if array.kind == "umap" and array.first_iid
    ]
    assert len(later) == 2
    for each in later:
        shutil.rmtree(path / "runs.zarr" / each)
    fit_points = umap_projection._fit_points

    def on_another_processor(*arguments):
        points, transform = fit_points(*arguments)
        return points[:, ::-1], transform

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(umap_projection, "_fit_points", on_another_processor)
        with pytest.raises(RequestError, match=r"cannot be repeated here.*--refit"):
            precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS))
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS))
    assert verify(path) == []


def test_later_parts_are_transformed_by_the_fit_to_a_sample_and_nothing_else_is(
    scan, tmp_path, monkeypatch
):
    """So that the projection takes no longer where more instances are stored."""
    path = ingest_parts(scan, tmp_path / "s.s2r", FIRST, 40)
    fit_points, transformed = umap_projection._fit_points, []
    settings = replace(umap_projection.SETTINGS, fit_instances=12, neighbours=4)
    monkeypatch.setattr(umap_projection, "SETTINGS", settings)
    monkeypatch.setattr(run_stages, "_fitted", lambda *arguments: FIRST)

    def counted(points, settings):
        embedded, transform = fit_points(points, settings)
        transformed.append((len(points), 0))
        return embedded, lambda others: transformed.append((0, len(others))) or transform(others)

    monkeypatch.setattr(umap_projection, "_fit_points", counted)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions((), workers=1))
    others, later = FIRST - 6, 40 - FIRST
    assert transformed == [(12, 0), *2 * [(0, others)], (12, 0), *2 * [(0, later)]]
    with s2rstore.open(path) as store:
        assert np.isfinite(values(store, "umap", "sim")).all()


def test_heat_ranges_do_not_depend_on_the_parts(whole, parted, tmp_path, monkeypatch):
    monkeypatch.setattr(publish_results, "_RANGE_ROWS", 10)
    ranges = []
    for store in (whole, parted):
        path = tmp_path / store.name
        copy_store(store, path)
        with edit(path) as draft:
            draft.delete("zarr_array", kind="activation")
        assert precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS))
        with s2rstore.open(path) as opened:
            ranges.append(opened.provenance_object("run:vanilla", "heat ranges"))
    assert ranges[0].keys() == ranges[1].keys()
    for name, (low, high) in ranges[0].items():
        np.testing.assert_allclose(ranges[1][name], (low, high), atol=0.01 * (high - low))


def test_a_data_set_that_grows_meanwhile_is_planned_again(scan, tmp_path, monkeypatch):
    path = ingest_parts(scan, tmp_path / "s.s2r", FIRST)
    compute_stages = pipeline._compute_stages

    def grow(*arguments) -> None:
        compute_stages(*arguments)
        with s2rstore.open(path) as store:
            parts = store.parts
        if len(parts) == 1:
            ingest(part_of(scan, {"traj1": 40}, SIDES), path)

    monkeypatch.setattr(pipeline, "_compute_stages", grow)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(()))
    with s2rstore.open(path) as store:
        firsts = [r.first_iid for r in store.array_parts("vanilla") if r.kind == "prediction"]
        assert sorted(firsts) == [0, 0, FIRST, FIRST]
        assert store.run_columns("vanilla").valid.all()


def test_what_is_computed_for_some_parts_is_noted_and_refused_for_others(parted, tmp_path, s2r):
    path = copy_store(parted, tmp_path / "s.s2r")
    withdraw_later_arrays(path, "kind LIKE 'map:pixel%'")
    with s2rstore.open(path) as store:
        assert np.isfinite(store.map_grid("vanilla", "activation", "sim")).any()
        with pytest.raises(RequestError, match="not computed for all instances"):
            store.map_grid("vanilla", "pixel_difference", "sim")
    withdraw_later_arrays(path, "kind = 'activation'")
    verified = s2r("verify", path)
    assert verified.code == 0
    note = "run vanilla: computed for some instances only: activation real, activation sim"
    assert note in verified.out + verified.err
    with s2rstore.open(path) as store:
        assert store.heatmap("vanilla", "activation", "sim", FIRST - 1).ndim == 2
        with pytest.raises(NotComputedError, match=f"instance {FIRST}: activation of"):
            store.heatmap("vanilla", "activation", "sim", FIRST)
    withdraw_later_arrays(path, "true")
    with s2rstore.open(path) as store:
        assert len(neighbours(store, "vanilla", "sim", FIRST, 5)[0]) == 0
        near, _ = neighbours(store, "vanilla", "sim", 0, 40)
        assert near.max() < FIRST
    assert f"computed for {FIRST} of 40 instances" in s2r("runs", path).out


@pytest.mark.parametrize(
    "rows", [[(0, 0, 24), (1, 25, 15)], [(0, 0, 24)], [(1, 0, 40)], [(0, 0, 40), (0, 40, 1)]]
)
def test_parts_with_gaps_or_other_counts_are_refused(whole, tmp_path, rows):
    path = copy_store(whole, tmp_path / "s.s2r")
    with edit(path) as draft:
        for part, first, count in rows:
            draft.insert_row(
                "part", {"part": part, "first_iid": first, "instances": count, "hash": "0" * 64}
            )
    with pytest.raises(RequestError, match="table part"):
        s2rstore.open(path)
