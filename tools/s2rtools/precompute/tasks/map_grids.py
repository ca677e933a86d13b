"""Task: map grids, the heat of every instance projected on the floor and aggregated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.floor_grid import AGGREGATES, CELLS, HEIGHTS, FloorHeat, MapGrid
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run, Side
from s2rstore.run_inputs import run_domain
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.precompute.frame_reader import RunFrames
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit, content_key

MAP_SETTINGS: dict[str, Any] = {"cells": CELLS, "heights": list(HEIGHTS), "version": 1}
MAP_ROWS = 4096
_READ_ROWS = 64


def map_stages(store: Store, forward: Stage, others: Sequence[Stage]) -> list[Stage]:
    """Map grids of every heatmap of the stages of a part, one stage per kind and side."""
    grid = MapGrid(store.dataset.bounds)
    predictions = forward.specs_of_kind("prediction")
    stages = []
    for stage in (forward, *others):
        for kind in dict.fromkeys(spec.kind for spec in stage.specs if spec.kind in HEATMAP_KINDS):
            heat = stage.specs_of_kind(kind)
            for side in SIDES:
                specs = [
                    _map_spec(spec, side, mode, grid)
                    for spec in heat
                    if spec.side in (side, None)
                    for mode in HEATMAP_KINDS[kind].planes or (spec.mode,)
                ]
                stages.append(
                    Stage(f"map:{kind}:{side}", stage.run, tuple(specs), MAP_ROWS,
                          predictions + heat + forward.sources, is_aggregate=True)
                )  # fmt: skip
    return stages


def _map_spec(spec: ArraySpec, side: str, mode: str | None, grid: MapGrid) -> ArraySpec:
    kind = HEATMAP_KINDS[spec.kind]
    surface = {"surface": kind.surface} if kind.aligned else {}
    return ArraySpec(
        f"map:{spec.kind}", side, mode, (grid.rows, grid.cols), "float32",
        ("aggregate", "row", "column"), spec.unit,
        content_key({"heat": spec.key, **MAP_SETTINGS, **surface}),
        len(AGGREGATES), (("aggregates", ",".join(AGGREGATES)),), spec.first_iid,
    )  # fmt: skip


def compute_grids(store: Store, run: Run, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """Mean, max, sum and count grids of a unit, of one kind on one side, for each of its modes.

    Heat is projected by the side's valid depth and calibrated rays; for kinds that compare both
    views, by the aligned rays at the nearer of both surfaces.
    """
    stage = unit.stage
    side: Side = "sim" if stage.name.endswith(":sim") else "real"
    kind = stage.specs[0].kind.removeprefix("map:")
    planes = HEATMAP_KINDS[kind].planes
    instances = unit.instances
    valid = stage.valid_instances(store.path, instances)
    other: Side = "real" if side == "sim" else "sim"
    floor_heat = FloorHeat(
        run_domain(store, run, side), run_domain(store, run, other), store.dataset, side,
        store.rig_offset(run.sim_domain, run.real_domain),
        HEATMAP_KINDS[kind].surface if HEATMAP_KINDS[kind].aligned else None,
    )  # fmt: skip
    frames = RunFrames(store, run, stage.rendered_arrays(store.path))
    poses = np.stack([store.instances.x, store.instances.y, store.instances.heading], axis=1)
    grids = {spec: MapGrid(store.dataset.bounds) for spec in unit.missing}
    for start in range(instances.start, instances.stop, _READ_ROWS):
        stop = min(start + _READ_ROWS, instances.stop)
        rows = np.flatnonzero(valid[start - instances.start : stop - instances.start])
        if not rows.size:
            continue
        depths = {
            name: frames.read(name, start, stop, ("depth",))["depth"][rows]
            for name in ((side, other) if floor_heat.needs_other else (side,))
        }
        depth = floor_heat.depth(depths[side], depths.get(other))
        for spec, grid in grids.items():
            array = stage.source_array(store.path, kind, side, None if planes else spec.mode)
            heat = np.asarray(array[start:stop][rows], dtype=np.float32)
            if heat.ndim == 4:
                heat = np.ascontiguousarray(heat[:, planes.index(spec.mode) if planes else 0])
            ray = HEATMAP_KINDS[kind].ray(spec.mode)
            floor_heat.add(grid, heat, depth, poses[start:stop][rows], ray)
    return {spec: grid.aggregates() for spec, grid in grids.items()}
