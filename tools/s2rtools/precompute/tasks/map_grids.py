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
_READ_ROWS = 64


def map_stages(store: Store, forward: Stage, others: Sequence[Stage]) -> list[Stage]:
    """Map grids of every heatmap of the given stages, one stage per kind and side."""
    grid = MapGrid(store.dataset.bounds)
    predictions = forward.specs_of_kind("prediction")
    stages = []
    for stage in (forward, *others):
        for kind in dict.fromkeys(spec.kind for spec in stage.specs if spec.kind in HEATMAP_KINDS):
            heat = stage.specs_of_kind(kind)
            for side in SIDES:
                specs = [
                    _map_spec(spec, side, mode, (grid.rows, grid.cols))
                    for spec in heat
                    if spec.side in (side, None)
                    for mode in HEATMAP_KINDS[kind].planes or (spec.mode,)
                ]
                stages.append(
                    Stage(f"map:{kind}:{side}", stage.run, tuple(specs),
                          len(AGGREGATES), predictions + heat + forward.sources)
                )  # fmt: skip
    return stages


def _map_spec(spec: ArraySpec, side: str, mode: str | None, shape: tuple[int, int]) -> ArraySpec:
    surface = (
        {"surface": HEATMAP_KINDS[spec.kind].surface} if HEATMAP_KINDS[spec.kind].aligned else {}
    )
    key = content_key({"heat": spec.key, **MAP_SETTINGS, **surface})
    names = ",".join(AGGREGATES)
    return ArraySpec(
        f"map:{spec.kind}", side, mode, shape, "float32", ("aggregate", "row", "column"),
        spec.unit, key, len(AGGREGATES), (("aggregates", names),),
    )  # fmt: skip


def compute_grids(store: Store, run: Run, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """Mean, max, sum and count grids of one kind on one side, for each of its modes.

    Heat is projected by the side's valid depth and calibrated rays; for kinds that compare both
    views, by the aligned rays at the nearer of both surfaces.
    """
    stage = unit.stage
    side: Side = "sim" if stage.name.endswith(":sim") else "real"
    kind = stage.specs[0].kind.removeprefix("map:")
    valid = stage.valid_instances(store.path)
    other: Side = "real" if side == "sim" else "sim"
    floor_heat = FloorHeat(
        run_domain(store, run, side), run_domain(store, run, other), store.dataset, side,
        store.rig_offset(run.sim_domain, run.real_domain),
        HEATMAP_KINDS[kind].surface if HEATMAP_KINDS[kind].aligned else None,
    )  # fmt: skip
    frames = RunFrames(store, run, stage.rendered_arrays(store.path))
    poses = np.stack([store.instances.x, store.instances.y, store.instances.heading], axis=1)
    grids = {spec: MapGrid(store.dataset.bounds) for spec in unit.missing}
    for start in range(0, valid.size, _READ_ROWS):
        stop = min(start + _READ_ROWS, valid.size)
        rows = np.flatnonzero(valid[start:stop])
        if not rows.size:
            continue
        depth = _depth(frames, floor_heat, side, other, slice(start, stop), rows)
        for spec, grid in grids.items():
            heat = _heat(stage.source_array, store, kind, side, spec.mode, start, stop)[rows]
            ray = HEATMAP_KINDS[kind].ray(spec.mode)
            floor_heat.add(grid, heat, depth, poses[start:stop][rows], ray)
    return {spec: grid.aggregates() for spec, grid in grids.items()}


def _depth(
    frames: RunFrames, floor_heat: FloorHeat, side: Side, other: Side, span: slice,
    rows: NDArray[np.intp],
) -> NDArray[Any]:  # fmt: skip
    """Raw depth (k, H, W) of the surface that carries the heat, for some instances of `span`."""

    def read(name: Side) -> NDArray[Any]:
        return frames.read(name, span.start, span.stop, ("depth",))["depth"][rows]

    return floor_heat.depth(read(side), read(other) if floor_heat.needs_other else None)


def _heat(
    source: Any, store: Store, kind: str, side: Side, mode: str | None, start: int, stop: int
) -> NDArray[np.float32]:
    """Maps of iids [start, stop), shape (n, h, w), only the requested plane."""
    planes = HEATMAP_KINDS[kind].planes
    array = source(store.path, kind, side, None if planes else mode)
    block = np.asarray(array[start:stop], dtype=np.float32)
    if block.ndim == 3:
        return block
    return np.ascontiguousarray(block[:, planes.index(mode) if planes else 0])
