"""Keys of arrays: what a change of the store computes again, and what runs share."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import add_run
from tests.conftest import BuildOnce
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

KINDS = ("activation", "pixel_difference", "harmonised_difference")
ALL = {"prediction", "activation", "pixel_difference", "harmonised_difference", "map"}
BACKEND = {"name": "torch", "precision": "float32"}


def keys_of(path: Path) -> dict[str, str]:
    with s2rstore.open(path) as store:
        keys = ArrayKeys(InputHashes(store), store.run("vanilla"), store.parts[0].iids)
        prediction = keys.prediction(BACKEND, [])
        heatmaps = {kind: keys.heatmap(kind, BACKEND, [])[0] for kind in KINDS}
        grids = keys.map("heat", prediction, {"cells": 264})
        return {"prediction": prediction, **heatmaps, "map": grids}


def rename_room(draft: IndexTransaction) -> None:
    (name,) = draft.rows("SELECT room FROM room LIMIT 1")[0]
    draft.update("room", {"room": name}, {"room": "renamed"})


def change_scale(draft: IndexTransaction) -> None:
    (name,) = draft.rows("SELECT name FROM dataset")[0]
    values = {"accuracy_scale": 3.0, "floor_plan": None, "hash": "a" * 64}
    draft.update("dataset", {"name": name}, values)


def move_bounds(draft: IndexTransaction) -> None:
    (name,) = draft.rows("SELECT name FROM dataset")[0]
    draft.update("dataset", {"name": name}, {"bounds_x0": -50.0})


def change_pose(draft: IndexTransaction) -> None:
    (trajectory,) = draft.rows("SELECT trajectory FROM trajectory LIMIT 1")[0]
    draft.update("instance", {"trajectory": trajectory}, {"heading": 1.0})


def move_camera(draft: IndexTransaction) -> None:
    draft.update("domain", {"domain": "real"}, {"camera_height": 0.7})


def change_depth_unit(draft: IndexTransaction) -> None:
    draft.update("domain", {"domain": "sim"}, {"depth_scale": 0.002})


def change_images(draft: IndexTransaction) -> None:
    draft.update("frame", {"domain": "real"}, {"sha256": "b" * 64})


@pytest.mark.parametrize(
    ("change", "changed"),
    [
        (rename_room, set()),
        (change_scale, set()),
        (move_bounds, {"map"}),
        (change_pose, {"activation", "map"}),
        (move_camera, {"harmonised_difference", "map"}),
        (change_depth_unit, ALL),
        (change_images, ALL),
    ],
)
def test_a_key_changes_with_the_inputs_of_its_arrays_alone(small_copy, change, changed):
    path = small_copy
    before = keys_of(path)
    with edit(path) as draft:
        change(draft)
    after = keys_of(path)
    assert {name for name in before if before[name] != after[name]} == changed


@pytest.fixture(scope="module")
def two_runs(small_store: Path, build_once: BuildOnce) -> Path:
    """A store with two computed runs of one model, and one of adjusted images."""
    return build_once("two-runs.s2r", lambda path: _compute_runs(copy_store(small_store, path)))


def _compute_runs(path: Path) -> None:
    bright = {"sim": [], "real": [{"name": "brightness", "value": 1.2}]}
    add_run(path, "again", "vanilla", None, None, {"sim": [], "real": []})
    add_run(path, "bright", "vanilla", None, None, bright)
    precompute(path, SilentReporter(), [], PrecomputeOptions(KINDS))


def test_arrays_that_need_no_model_are_stored_once(two_runs):
    with s2rstore.open(two_runs) as store:
        paths = {
            run: {r.path for r in store.array_kinds(run) if r.kind in KINDS[1:]}
            for run in store.runs
        }
        assert len(paths["vanilla"]) == 4
        assert all(path.startswith("_shared/") for path in paths["vanilla"])
        assert paths["again"] == paths["vanilla"]
        assert not paths["bright"] & paths["vanilla"]
        for record in store.array_kinds("again"):
            values = np.asarray(store.array("again", record.kind, record.side, record.mode)[1])
            _, other = store.array("vanilla", record.kind, record.side, record.mode)
            np.testing.assert_array_equal(values, np.asarray(other))
    assert verify(two_runs) == []


def test_shared_arrays_stay_as_long_as_a_run_uses_them(two_runs, tmp_path):
    path = copy_store(two_runs, tmp_path / "s.s2r")
    for run, shared in (("vanilla", 4), ("again", 2)):
        with edit(path) as draft:
            for table in ("zarr_array", "prediction", "projection", "run"):
                draft.delete(table, run=run)
        prune(path, keep=1)
        assert verify(path) == []
        assert len(list((path / "runs.zarr/_shared").iterdir())) == shared


def test_a_lost_array_is_computed_and_listed_again(two_runs, tmp_path):
    path = copy_store(two_runs, tmp_path / "s.s2r")
    with s2rstore.open(path) as store:
        lost = [r for r in store.array_kinds("vanilla") if r.kind == "neighbour_distance"]
    for record in lost:
        shutil.rmtree(path / "runs.zarr" / record.path)
    with edit(path) as draft:  # as an array whose metadata another release wrote
        draft.update("zarr_array", {"path": lost[0].path}, {"metadata_sha256": "c" * 64})
    assert precompute(path, SilentReporter(), [], PrecomputeOptions(KINDS)) == ["vanilla"]
    assert verify(path) == []


def test_provenance_states_where_each_array_was_computed(two_runs):
    with s2rstore.open(two_runs) as store:
        computed = store.provenance_object("run:vanilla", "arrays")
        keys = {record.path.split("/")[1] for record in store.array_parts("vanilla")}
    assert computed.keys() == keys
    for facts in computed.values():
        assert facts["device"]
        assert {"torch", "numpy"} <= facts["libraries"].keys()
