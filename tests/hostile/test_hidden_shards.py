"""Every entry point that reads an array of a store fails where one of its shards is missing."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.maintenance.prune import prune
from s2rstore.metrics.nearest_neighbours import neighbours
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rstore.run_inputs import run_frames
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.synthetic_world.factors import complete_severities
from s2rtools.training import pretrained
from s2rtui.charts.instance import instance_input
from s2rtui.cli import main
from s2rtui.session import heatmaps
from s2rtui.session.state import HeatChoice
from tests.conftest import BuildOnce
from tests.support.hidden_shards import (
    Function,
    array_of,
    command,
    files_read,
    hidden,
    linked_copy,
    outcome,
    shard_files,
)

RUNS = ("vanilla", "up")
"""Runs of the store; the sim camera of `up` is moved."""
COUNT = 6
"""Instances of either trajectory."""
FIRST = 4
"""Instances of the first part; the others of `traj1` are in the second one."""
IIDS = (0, FIRST, COUNT)
"""An instance of the first part, and one of either trajectory in the second part."""
HEATS = (
    "activation:loss", "activation:x", "activation:y", "activation:heading", "feature_distance",
    "pixel_difference:rgb", "pixel_difference:depth", "harmonised_distance",
    "harmonised_difference", "occlusion:rgb", "occlusion:depth", "occlusion:rgbd",
    "harm:position", "harm:heading", "harm:loss", "harm_fine:position", "harm_fine:heading",
    "harm_fine:loss",
)  # fmt: skip
MOVES = "sim:camera_height=0.1,brightness=1.2,camera_pitch=-5,camera_fov=6"


@pytest.fixture(scope="module")
def computed(build_once: BuildOnce, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A computed world of two parts with all heatmaps of two runs, whose shards may be moved."""
    store = build_once("hidden.s2r", _compute)
    return linked_copy(store, tmp_path_factory.mktemp("hidden") / "w.s2r")


def _compute(store: Path) -> None:
    """Write the store; its second part continues `traj1`."""
    world = {"count": COUNT, "factors": complete_severities()}
    scan = IMPORTERS["world"](Path(), ScanOptions(frame=(64, 64), world=world))
    first = replace(scan, trajectories={"traj1": scan.trajectories["traj1"][:FIRST]})
    build(first, store, "s2r ingest", True, lambda steps: None)
    pretrained.add_pretrained_models(store)
    moved = "--model", "vanilla", "--adjust", MOVES, "--store", str(store)
    assert main(["run", "add", "up", *moved]) == 0
    runs = [word for run in RUNS for word in ("--run", run)]
    assert main(["precompute", str(store), *runs]) == 0
    assert main(["ingest", "world", "--instances", str(COUNT), "--store", str(store),
                 "--append"]) == 0  # fmt: skip
    assert main(["precompute", str(store), *runs]) == 0
    prune(store, keep=1)  # of the arrays that were merged


# --- functions of an open store, in families that read the same arrays in the same way ------------


def stored_arrays(store: Store) -> Iterator[Function]:
    for run in store.runs:
        for record in store.array_parts(run):
            yield lambda record=record: store.stored(record)[:]


def whole_arrays(store: Store) -> Iterator[Function]:
    """The arrays that `Store.array` joins from their parts."""
    for run in store.runs:
        for record in store.array_kinds(run):
            if record.axes[0] == "iid":
                names = run, record.kind, record.side, record.mode
                yield lambda names=names: store.array(*names)[1][:]


def frames(store: Store) -> Iterator[Function]:
    for domain in SIDES:
        for iid in IIDS:
            yield lambda domain=domain, iid=iid: store.frame(iid, domain)


def run_images(store: Store) -> Iterator[Function]:
    """The images of the moved camera among them."""
    for run in RUNS:
        for side in SIDES:
            yield lambda run=run, side=side: run_frames(store, store.run(run), side, 0, 2 * COUNT)


def choices() -> Iterator[tuple[str, HeatChoice]]:
    for run, heat, side in product(RUNS, HEATS, SIDES):
        kind, _, mode = heat.partition(":")
        yield run, HeatChoice(kind, mode or None, side)


def instance_views(store: Store) -> Iterator[Function]:
    for (run, heat), iid in product(choices(), IIDS):
        yield lambda run=run, heat=heat, iid=iid: instance_input(store, run, iid, heat)


def maps_of_runs(store: Store) -> Iterator[Function]:
    for run, heat in choices():
        yield lambda run=run, heat=heat: heatmaps.run_grid(store, run, heat)


def maps_of_instances(store: Store) -> Iterator[Function]:
    for (run, heat), iid in product(choices(), IIDS):
        yield lambda run=run, heat=heat, iid=iid: heatmaps.instance_grid(store, run, heat, iid)


def maps_of_selections(store: Store) -> Iterator[Function]:
    iids = np.arange(2 * COUNT)
    for run, heat in choices():
        yield lambda run=run, heat=heat: heatmaps.selection_grid(store, run, heat, iids, "sum")


def seen_floor(store: Store) -> Iterator[Function]:
    iids = np.array(IIDS)
    for run in RUNS:
        for side in SIDES:
            yield lambda run=run, side=side: heatmaps.visible_floor(store, run, side, iids)


def similar(store: Store) -> Iterator[Function]:
    for run in RUNS:
        for side in SIDES:
            yield lambda run=run, side=side: neighbours(store, run, side, 1, 3)


FAMILIES = (
    stored_arrays, whole_arrays, frames, run_images, instance_views, maps_of_runs,
    maps_of_instances, maps_of_selections, seen_floor, similar,
)  # fmt: skip

EXPORT = "export", "{store}", "--out", "{out}", "--view"


def check(functions: Iterable[Function], path: Path, most: int = 1000) -> set[str]:
    """Hide each shard that one of the functions reads, `most` for each; gives these shards.

    A function must fail and name the shard. It must not change where all shards that it does not
    read are hidden.
    """
    shards, tried = set(shard_files(path)), set()
    for function in functions:
        with files_read(path) as names:
            whole = outcome(function)
        assert whole.code in (0, 3), whole.error
        used = names & shards
        if used and used <= tried:
            continue
        new = sorted(used - tried)
        for shard in new[:: -(-len(new) // most) or 1]:
            with hidden(path, [shard]):
                found = outcome(function)
            assert (found.code, found.result) == (2, None), shard
            assert str(path / shard) in found.error, (shard, found.error)
        with hidden(path, shards - used):
            assert outcome(function) == whole
        tried |= used
    return tried


def check_functions(family: Callable[[Store], Iterable[Function]], path: Path) -> None:
    with s2rstore.open(path) as store:

        def without_cache(function: Function) -> Function:
            return lambda: store.embeddings.clear() or function()

        assert check(map(without_cache, family(store)), path)


@pytest.mark.parametrize("family", [stored_arrays, whole_arrays, frames], ids=lambda f: f.__name__)
def test_functions_name_a_hidden_shard_of_a_small_store(family, store_copy):
    check_functions(family, store_copy)


def test_a_command_names_a_hidden_shard(store_copy):
    words = (*EXPORT, "map", "--heat", "feature_distance", "--on", "selection", "--clip")
    assert check([command(store_copy, *words)], store_copy, most=1)


@pytest.mark.deep
@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.__name__)
def test_functions_name_a_hidden_shard(family, computed):
    check_functions(family, computed)


@pytest.mark.deep
def test_every_kind_of_array_is_covered(computed):
    with s2rstore.open(computed) as store, files_read(computed) as read:
        for function in (*stored_arrays(store), *frames(store)):
            function()
    assert set(shard_files(computed)) <= read
    with s2rstore.open(computed) as store:
        for run in RUNS:
            known = heatmaps.heatmap_choices(store, run)
            assert sorted(":".join(filter(None, names)) for names in known) == sorted(HEATS)
        kinds = {record.kind for record in store.array_kinds("up")}
    assert kinds >= {"prediction", "embedding", "pca", "umap", "neighbour_distance", "gap_shares"}
    assert kinds >= {"frames:rgb", "frames:depth", "map:occlusion"}
    parts = {}
    for shard in shard_files(computed):
        if shard.startswith("runs.zarr/"):
            name = array_of(computed, shard).split("/")
            parts.setdefault((name[1], name[3]), set()).add(name[2])
    owned = {len(keys) for (owner, _), keys in parts.items() if owner != "_shared"}
    assert owned == {1, 2}  # arrays that were merged, and arrays in two parts
    assert {len(keys) for (owner, _), keys in parts.items() if owner == "_shared"} == {1, 2}
