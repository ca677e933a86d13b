"""Map grids: equal to a plain computation, from one pass over the images, merged from ranges."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.geometry.map_grid import AGGREGATES
from s2rstore.reader import Store
from s2rtools.models.load_model import load_model
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.run_backends import BackendIdentity, RunBackends
from s2rtools.precompute.tasks.map_grids import compute_grids, map_stages, merge_grids
from s2rtools.precompute.tasks.network_outputs import network_stages
from s2rtools.precompute.tasks.rendered_frames import frames_stages
from s2rtools.precompute.work_units import Stage
from tests.support.plain_maps import plain_map_grid

KINDS = ("feature_distance", "pixel_difference", "harmonised_distance")


@pytest.fixture(scope="module")
def store(moved_camera_store: Path) -> Store:
    return s2rstore.open(moved_camera_store)


def map_stage(store: Store, name: str, kinds: tuple[str, ...] = KINDS) -> Stage:
    """The stage of the map grids of a run of the store."""
    run, iids = store.run(name), store.parts[0].iids
    keys = ArrayKeys(InputHashes(store), run, iids)
    rendered = tuple(s for stage in frames_stages(store, keys, run, iids) for s in stage.specs)
    torch = BackendIdentity("torch", str(run.precision))
    backends = RunBackends(torch, torch)
    model = load_model(store, run.model)
    forward, others = network_stages(keys, run, iids, model, backends, kinds, rendered)
    (stage,) = map_stages(store, keys, forward, others)
    return stage


@pytest.mark.parametrize("run", ["vanilla", "up", "low"])
def test_published_grids_equal_a_plain_computation(store, run):
    records = [record for record in store.array_kinds(run) if record.kind.startswith("map:")]
    assert len(records) == 8
    for record in records:
        kind = record.kind.removeprefix("map:")
        plain = plain_map_grid(store, run, kind, record.side, record.mode)
        assert plain["count"].sum() > 1000
        for aggregate in AGGREGATES:
            found = store.map_grid(run, kind, record.side, record.mode, aggregate)
            np.testing.assert_allclose(
                found, plain[aggregate], rtol=1e-5, atol=1e-6, err_msg=f"{record} {aggregate}"
            )


@pytest.mark.parametrize("stops", [(8,), (3, 8), (1, 2, 5, 8)])
def test_merged_ranges_equal_the_published_grids(store, stops):
    stage, run = map_stage(store, "up"), store.run("up")
    starts = (0, *stops)
    ranges = [range(*ends) for ends in zip(starts, stops, strict=False)]
    parts = [compute_grids(store, run, stage, each, stage.specs) for each in ranges]
    merged, again = merge_grids(parts), merge_grids(iter(parts))
    assert merged.keys() == set(stage.specs)
    for spec, grid in merged.items():
        assert grid.dtype == np.float32
        assert grid.tobytes() == again[spec].tobytes()
        _, published = store.array("up", spec.kind, spec.side, spec.mode)
        np.testing.assert_allclose(grid, published[:], rtol=1e-6, atol=1e-6)


def test_parts_of_different_arrays_are_not_merged(store):
    stage, run = map_stage(store, "vanilla"), store.run("vanilla")
    part = compute_grids(store, run, stage, range(2), stage.specs[:2])
    assert merge_grids([]) == {}
    with pytest.raises(ValueError, match="different map grids"):
        merge_grids([part, {stage.specs[0]: part[stage.specs[0]]}])


def test_a_range_without_valid_instances_adds_nothing(store, monkeypatch):
    stage, run = map_stage(store, "vanilla"), store.run("vanilla")
    whole = merge_grids([compute_grids(store, run, stage, range(8), stage.specs)])
    monkeypatch.setattr(
        Stage, "valid_instances", lambda self, root, instances: np.array(instances) < 3
    )
    parts = [
        compute_grids(store, run, stage, each, stage.specs) for each in (range(4), range(4, 8))
    ]
    first = compute_grids(store, run, stage, range(3), stage.specs)
    merged = merge_grids(parts)
    for spec, grid in merge_grids([first]).items():
        np.testing.assert_array_equal(merged[spec], grid)
        assert grid[3].sum() < whole[spec][3].sum()
        nothing = merge_grids(parts[1:])[spec]
        assert np.isnan(nothing[:3]).all()
        assert (nothing[3] == 0).all()
