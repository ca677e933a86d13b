"""Precompute of a store with a continued trajectory and an added domain."""

import hashlib
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import torch

import s2rstore
from s2rstore.errors import NotComputedError, RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import check
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.datasets.appending.append import append
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import Scan, ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.models import build_network
from s2rtools.models.model_registration import pack_weights, register_model
from s2rtools.precompute import pipeline
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import insert_run
from tests.support import pairs
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

KINDS = ("activation", "pixel_difference")
EDIT = "sim_edit"
N = 10
CUTS = {"a": 4, "b": 3}
"""Instances of the first ingest, which are continued by two appends."""


def part_of(scan: Scan, counts: dict[str, int], domains: tuple[str, ...]) -> Scan:
    trajectories = {
        name: [
            replace(r, sources={d: r.sources[d] for d in domains})
            for r in scan.trajectories[name][:count]
        ]
        for name, count in counts.items()
    }
    kept = {name: scan.domains[name] for name in domains}
    return replace(scan, domains=kept, trajectories=trajectories, issues=[])


def ingest(part: Scan, store: Path) -> None:
    """Make a store of a part of a data set, or append the part to a store."""
    add = append if store.exists() else build
    add(part, store, "s2r ingest", True, lambda steps: None)


def add_run(store: Path, name: str, sim: str) -> None:
    with edit(store) as draft:
        if not draft.rows("SELECT 1 FROM model"):
            torch.manual_seed(3)
            network = build_network("resposenet")
            register_model(store, draft, "m", pack_weights(network), network.convention)
        insert_run(draft, name, "m", (sim, "real"))


def compute(store: Path, run: str) -> None:
    precompute(store, SilentReporter(), [run], PrecomputeOptions(KINDS, backend="torch"))


def array_files(store: Path) -> dict[str, str]:
    return {
        path.relative_to(store).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for folder in ("runs.zarr", "frames.zarr")
        for path in (store / folder).rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Scan:
    """Two trajectories of ten pairs, whose simulated images were edited, too."""
    root = tmp_path_factory.mktemp("data")
    header = pairs.sim2realviz(root, n=N, trajectories=("a", "b"), edit=True)
    return IMPORTERS["sim2realviz"](root, ScanOptions(header=header, frame=(32, 32)))


@pytest.fixture(scope="module")
def stores(scan: Scan, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A computed store that was ingested at once, and one that grew; runs `plain` and `edited`."""
    root = tmp_path_factory.mktemp("grown")
    once, grown = root / "once.s2r", root / "grown.s2r"
    ingest(scan, once)
    for name, sim in (("plain", "sim"), ("edited", EDIT)):
        add_run(once, name, sim)
        compute(once, name)
    ingest(part_of(scan, CUTS, SIDES), grown)
    add_run(grown, "plain", "sim")
    compute(grown, "plain")
    for counts, domains in (({"a": 4, "b": 7}, SIDES), ({"a": N, "b": N}, (*SIDES, EDIT))):
        before = array_files(grown)
        with s2rstore.open(grown) as earlier, pytest.MonkeyPatch.context() as patch:
            ingest(part_of(scan, counts, domains), grown)
            patch.setattr(pipeline, "publish_run", Mock(side_effect=KeyboardInterrupt))
            with pytest.raises(KeyboardInterrupt):  # between merging and publishing
                compute(grown, "plain")
            patch.undo()
            patch.setattr(pipeline.UnitPlan, "finish", Mock(side_effect=AssertionError))
            compute(grown, "plain")
            assert np.isfinite(earlier.array("plain", "prediction", "sim")[1][:]).all()
        after = array_files(grown)
        assert {path: after[path] for path in before} == before
    add_run(grown, "edited", EDIT)
    compute(grown, "edited")
    return once, grown


def by_position(store: Store, run: str) -> list[tuple[object, ...]]:
    names = "x, y, heading, error, heading_error, loss, accuracy, split"
    return store.execute(
        f"SELECT trajectory, seq, side, {', '.join(f'p.{n.strip()}' for n in names.split(','))} "
        "FROM prediction p JOIN instance USING (iid) WHERE run = ? ORDER BY trajectory, seq, side",
        [run],
    )


@pytest.mark.parametrize("run", ["plain", "edited"])
def test_predictions_equal_those_of_a_store_that_was_ingested_at_once(stores, run):
    with s2rstore.open(stores[0]) as once, s2rstore.open(stores[1]) as grown:
        expected, found = by_position(once, run), by_position(grown, run)
        assert [row[:3] for row in found] == [row[:3] for row in expected]
        np.testing.assert_allclose(
            [row[3:-1] for row in found], [row[3:-1] for row in expected], rtol=0, atol=1e-5
        )
        ranks = grown.run_columns(run).real
        assert sorted(ranks.rank.tolist()) == list(range(1, 2 * N + 1))
        assert (np.diff(ranks.error[np.argsort(ranks.rank)]) >= 0).all()
        for side in SIDES:
            heat = [
                np.concatenate([s.array(run, "activation", side)[1].at(s.iids_of(t)) for t in "ab"])
                for s in (once, grown)
            ]
            np.testing.assert_allclose(heat[1], heat[0], rtol=1e-3, atol=1e-5)
    assert check(stores[1]).damages == check(stores[1]).notes == ()


def test_arrays_of_parts_are_merged_and_superseded_ones_pruned(stores, tmp_path):
    """Points of a published projection stay; those of later parts have arrays of their own."""
    path = copy_store(stores[1], tmp_path / "s.s2r")
    prune(path, keep=1)
    keys = {f"{each.parent.name}/{each.name}" for each in (path / "runs.zarr").glob("*/*")}
    with s2rstore.open(path) as grown:
        assert [part.first_iid for part in grown.parts] == [0, 7, 11]
        for run, fitted in (("plain", {(0, 7), (7, 13)}), ("edited", {(0, 20)})):
            rows: dict[str, set[tuple[int, int]]] = {}
            for record in grown.array_parts(run):
                if record.axes[0] == "iid":
                    rows.setdefault(record.kind, set()).add((record.first_iid, record.shape[0]))
            later = dict.fromkeys(("pca", "umap", "neighbour_distance"), fitted)
            assert rows == {kind: {(0, 2 * N)} for kind in rows} | later
        assert keys == {"/".join(each.split("/")[:2]) for each in grown.array_paths}
    assert check(path).damages == check(path).notes == ()


@pytest.fixture(scope="module")
def gapped(scan: Scan, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A store whose second part lacks the edited images, computed after each append.

    Also the instances of the store ingested at once that its own are, (17,).
    """
    path = tmp_path_factory.mktemp("gapped") / "s.s2r"
    domains = (*SIDES, EDIT)
    ingest(part_of(scan, {"a": 4}, domains), path)
    add_run(path, "edited", EDIT)
    add_run(path, "plain", "sim")
    for counts, present in (({}, domains), ({"a": 7, "b": 3}, SIDES), ({"a": 7, "b": 6}, domains)):
        part = part_of(scan, counts, present)
        if EDIT in present:
            part.trajectories = {"c": list(part.trajectories["b"])[3:]} if counts else {}
        if part.trajectories:
            ingest(part, path)
        for run in ("edited", "plain"):
            compute(path, run)
    return path, np.array([0, 1, 2, 3, 4, 5, 6, N, N + 1, N + 2, N + 3, N + 4, N + 5])


def test_a_run_leaves_out_instances_that_one_of_its_domains_does_not_image(stores, gapped):
    path, iids = gapped
    covered = np.isin(np.arange(iids.size), [0, 1, 2, 3, 10, 11, 12])
    with s2rstore.open(stores[0]) as once, s2rstore.open(path) as store:
        assert store.imaged(EDIT, "real").tolist() == covered.tolist()
        for run, known in (("edited", covered), ("plain", np.ones(iids.size, dtype=bool))):
            assert run_metrics.population(store, run).tolist() == known.tolist()
            for side in SIDES:
                found, expected = (
                    store.run_columns(run).side(side),
                    once.run_columns(run).side(side),
                )
                assert np.isfinite(found.error).tolist() == found.imaged.tolist()
                np.testing.assert_allclose(
                    found.error[known], expected.error[iids[known]], rtol=0, atol=1e-5
                )
                assert np.isfinite(found.u).tolist() == known.tolist()
                heat = store.array(run, "activation", side)[1].at(known)
                whole = once.array(run, "activation", side)[1].at(iids[known])
                np.testing.assert_allclose(heat, whole, rtol=1e-3, atol=1e-5)
                assert store.map_grid(run, "pixel_difference", side, "rgb", "count").ndim == 2
        query = "SELECT count(*) FROM prediction WHERE run = 'edited' AND split IS NULL"
        assert store.execute(query) == [(6,)]
        with pytest.raises(NotComputedError, match="instance 4: "):
            store.heatmap("edited", "activation", "real", 4)
    assert check(path).damages == check(path).notes == ()


def test_instances_of_one_side_are_predicted_and_change_no_figure_of_pairs(scan, tmp_path):
    """They come before the pairs and after them, and are those of both sides in `pairs_alone`."""
    pairs_alone, mixed = tmp_path / "pairs.s2r", tmp_path / "mixed.s2r"
    later = part_of(scan, {"a": 4}, SIDES)
    later.trajectories = {"c": later.trajectories["a"]}
    real_only = replace(later, trajectories={"c": [
        replace(r, sources={"real": r.sources["real"]}) for r in later.trajectories["c"]
    ]})  # fmt: skip
    real_only.domains = {"real": scan.domains["real"]}
    ingest(part_of(scan, {"b": N}, SIDES), pairs_alone)
    ingest(part_of(scan, {"a": N}, ("sim",)), mixed)
    ingest(part_of(scan, {"b": N}, SIDES), mixed)
    for store in (pairs_alone, mixed):
        add_run(store, "plain", "sim")
        compute(store, "plain")
    ingest(real_only, mixed)
    before = array_files(mixed)
    compute(mixed, "plain")
    after = array_files(mixed)
    assert before.items() <= after.items()
    assert len(after) - len(before) == 2  # the predictions of one side, and their metadata
    assert check(mixed).damages == ()
    with s2rstore.open(pairs_alone) as alone, s2rstore.open(mixed) as store:
        columns = store.run_columns("plain")
        paired = columns.paired
        assert np.flatnonzero(paired).tolist() == list(range(N, 2 * N))
        for side in SIDES:
            found, expected = columns.side(side), alone.run_columns("plain").side(side)
            for name in ("x", "heading", "error", "u", "v", "outlier", "rank", "split"):
                values = getattr(found, name)
                np.testing.assert_allclose(values[paired], getattr(expected, name), rtol=1e-5)
            for values in (found.u, found.outlier, found.rank):
                assert not (values[~paired] > 0).any()
            np.testing.assert_array_equal(np.isfinite(found.error), found.imaged)
            grids = (s.map_grid("plain", "pixel_difference", side, "rgb") for s in (store, alone))
            np.testing.assert_allclose(*grids)
        assert store.coverage("plain").not_imaged == N + 4
        assert store.coverage("plain").computed == N
        with pytest.raises(RequestError, match=r"domain real has no images of trajectory a"):
            store.frame("real", 0)
        _assert_as_paired(scan, store, tmp_path)


def _assert_as_paired(scan: Scan, store: Store, folder: Path) -> None:
    """Images of one side get the predictions that they get in pairs of trajectory a."""
    whole = folder / "whole.s2r"
    ingest(part_of(scan, {"a": N}, SIDES), whole)
    add_run(whole, "plain", "sim")
    compute(whole, "plain")
    with s2rstore.open(whole) as both:
        for side, trajectory, count in (("sim", "a", N), ("real", "c", 4)):
            found = store.run_columns("plain").side(side).error[store.iids_of(trajectory)]
            expected = both.run_columns("plain").side(side).error[:count]
            np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_trajectory_whose_missing_images_are_added_is_computed(scan, stores, tmp_path):
    path = tmp_path / "s.s2r"
    real_only = part_of(scan, {"b": N}, ("real",)).trajectories
    first = part_of(scan, {"a": N}, SIDES)
    first.trajectories = {**first.trajectories, **real_only}
    ingest(first, path)
    add_run(path, "plain", "sim")
    compute(path, "plain")
    with s2rstore.open(path) as store:
        assert store.coverage("plain").computed == N
    ingest(part_of(scan, {"a": N, "b": N}, SIDES), path)
    waiting = check(path)
    assert waiting.damages == ()
    assert f"run plain: computed for {N} of {2 * N} instances; `s2r precompute`" in waiting.notes[0]
    compute(path, "plain")
    with s2rstore.open(path) as store, s2rstore.open(stores[0]) as once:
        assert store.coverage("plain").computed == 2 * N
        assert np.isfinite(store.run_columns("plain").real.u).all()
        expected, found = by_position(once, "plain"), by_position(store, "plain")
        np.testing.assert_allclose(
            [row[3:-1] for row in found], [row[3:-1] for row in expected], rtol=0, atol=1e-5
        )
    assert check(path).damages == check(path).notes == ()
