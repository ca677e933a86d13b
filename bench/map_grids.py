"""Floor maps of all heatmap kinds in one pass over the images, against one pass per kind."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import s2rstore
from bench.budget import BudgetRow
from bench.measured_stores import frames_store, lively
from s2rstore.arrays import array_writer
from s2rstore.geometry.floor_grid import Projector
from s2rstore.geometry.map_grid import MapGrid
from s2rstore.geometry.reprojection import NearerSurface, heat_surface
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run, Side
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.models.load_model import load_model
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.frame_reader import RunFrames
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.run_backends import BackendIdentity, RunBackends
from s2rtools.precompute.tasks.map_grids import compute_grids, map_stages, merge_grids
from s2rtools.precompute.tasks.network_outputs import as_stored, network_stages
from s2rtools.precompute.work_units import ArraySpec, Stage

INSTANCES, FRAME = 64, 256
_ROWS = 64


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Project noise heatmaps of every kind at the usual sizes, in this process."""
    path = frames_store(folder / "maps.s2r", INSTANCES, FRAME, lively("posest"))
    with edit(path) as draft:
        offset = {"height": -0.1, "zoom": 1.05, "frames": 1, "version": 2}
        draft.set_provenance("alignment:sim|real", {k: json.dumps(v) for k, v in offset.items()})
    with s2rstore.open(path) as store:
        run = store.run("r")
        stage = _filled_stage(store, run)
        one_pass = partial(_one_pass, store, run, stage)
        pass_per_kind = partial(_pass_per_kind, store, run, stage)
        grids, reads = _counted(one_pass)
        plain, plain_reads = _counted(pass_per_kind)
        for spec, grid in grids.items():
            np.testing.assert_allclose(grid, plain[spec], rtol=1e-5, atol=1e-5)
        fast, slow = _shortest(one_pass, pass_per_kind, times=4)
    images = INSTANCES * len(SIDES)
    yield BudgetRow("floor maps, passes over depth", reads / images, "passes", 2)
    yield BudgetRow("floor maps, a pass per kind: passes", plain_reads / images, "passes")
    yield BudgetRow(f"floor maps, {len(grids)} grids", 1000 * fast / INSTANCES, "ms/instance")
    yield BudgetRow("floor maps, a pass per kind", 1000 * slow / INSTANCES, "ms/instance")
    yield BudgetRow("floor maps / a pass per kind", fast / slow, "ratio", 0.5)


def _filled_stage(store: Store, run: Run) -> Stage:
    """The stage of all map grids, its sources filled with noise, some of it NaN."""
    model = load_model(store, run.model)
    torch = BackendIdentity("torch", "float32")
    backends = RunBackends(torch, torch)
    iids = store.parts[0].iids
    keys = ArrayKeys(InputHashes(store), run, iids)
    forward, others = network_stages(keys, run, iids, model, backends, tuple(HEATMAP_KINDS))
    rng = np.random.default_rng(0)
    for stage in (forward, *others):
        for spec in stage.specs:
            array = stage.create(store.path, spec)
            for shard in range(array.layout.shards):
                rows = _noise(rng, spec, array.rows_in(shard))
                array_writer.write_shard(array.path, shard, rows, store.path)
    (maps,) = map_stages(store, keys, forward, others)
    return maps


def _noise(rng: np.random.Generator, spec: ArraySpec, count: int) -> np.ndarray:
    values = rng.random((count, *spec.item), dtype=np.float32)
    if spec.dtype == "float16" and "row" in spec.axes:
        values[values < 0.1] = np.nan
    return as_stored(values, spec.dtype)


def _counted(work: Any) -> tuple[dict[ArraySpec, np.ndarray], int]:
    """The result of the work, and how many depth images it read."""
    reads, read = 0, RunFrames.read

    def counting(
        self: RunFrames, side: Side, start: int, stop: int, images: tuple[str, ...]
    ) -> Any:
        nonlocal reads
        reads += stop - start
        return read(self, side, start, stop, images)

    with mock.patch.object(RunFrames, "read", counting):
        return work(), reads


def _shortest(*works: Callable[[], Any], times: int) -> list[float]:
    """The shortest time of each work in seconds; they take turns, so that load hits all alike."""
    taken: list[list[float]] = [[] for _ in works]
    for _ in range(times):
        for work, found in zip(works, taken, strict=True):
            began = time.perf_counter()
            work()
            found.append(time.perf_counter() - began)
    return [min(found) for found in taken]


def _one_pass(store: Store, run: Run, stage: Stage) -> dict[ArraySpec, np.ndarray]:
    ranges = (range(start, start + _ROWS) for start in range(0, INSTANCES, _ROWS))
    return merge_grids(compute_grids(store, run, stage, each, stage.specs) for each in ranges)


def _pass_per_kind(store: Store, run: Run, stage: Stage) -> dict[ArraySpec, np.ndarray]:
    """Read and project the images again for each kind and side; the depth also for each mode."""
    groups: dict[tuple[str, str | None], list[ArraySpec]] = {}
    for spec in stage.specs:
        groups.setdefault((spec.kind.removeprefix("map:"), spec.side), []).append(spec)
    grids = {spec: MapGrid(store.dataset.bounds) for spec in stage.specs}
    frames = RunFrames(store, run)
    truth = store.instances
    poses = np.stack([truth.x, truth.y, truth.heading], axis=1)
    shape = store.dataset.frame_height, store.dataset.frame_width
    rig_offset = store.rig_offset(run.sim_domain, run.real_domain)
    for (name, side), specs in groups.items():
        kind = HEATMAP_KINDS[name]
        near: Side = "sim" if side == "sim" else "real"
        far: Side = "real" if near == "sim" else "sim"
        surface = kind.surface if kind.aligned else None
        view, nearer_to = heat_surface(
            store.domain(near), store.domain(far), near == "real", rig_offset, surface
        )
        projector = Projector(view, shape, store.dataset.y_down)
        nearer = nearer_to and NearerSurface(view, nearer_to, shape)
        for start in range(0, INSTANCES, _ROWS):
            stop = min(start + _ROWS, INSTANCES)
            depth = frames.read(near, start, stop, ("depth",))["depth"]
            if nearer is not None:
                depth = nearer(depth, frames.read(far, start, stop, ("depth",))["depth"])
            for spec in specs:
                array = stage.source_array(
                    store.path, name, side, None if kind.planes else spec.mode
                )
                heat = np.asarray(array[start:stop], dtype=np.float32)
                if heat.ndim == 4:
                    plane = kind.planes.index(str(spec.mode)) if kind.planes else 0
                    heat = np.ascontiguousarray(heat[:, plane])
                ray = kind.ray(spec.mode)
                grid = grids[spec]
                grid.add(*projector.project(heat, depth, poses[start:stop], ray, grid))
    return {spec: grid.aggregates() for spec, grid in grids.items()}
