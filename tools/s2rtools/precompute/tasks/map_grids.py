"""Map grids: every instance's heat back-projected on the floor and aggregated."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import floor_grid as map_geometry
from s2rstore.reader import Store
from s2rstore.records import Run, Side
from s2rstore.run_inputs import run_domain
from s2rtools.heatmaps import KINDS
from s2rtools.precompute.frame_reader import RunFrames
from s2rtools.precompute.work_units import ArraySpec, Unit

_READ_ROWS = 64


def grids(store: Store, run: Run, unit: Unit) -> dict[ArraySpec, NDArray[Any]]:
    """Mean, max, sum and count grids of one kind on one side, for each of its modes.

    Heat goes through that side's own valid depth and calibrated rays; for kinds that compare both
    views, through the aligned rays at the nearer of both surfaces.
    """
    stage = unit.stage
    side: Side = "sim" if stage.name.endswith(":sim") else "real"
    kind = stage.specs[0].kind.removeprefix("map:")
    valid = stage.valid(store.path)
    other: Side = "real" if side == "sim" else "sim"
    floor_heat = map_geometry.FloorHeat(
        run_domain(store, run, side), run_domain(store, run, other), store.dataset, side,
        store.rig_offset(run.sim_domain, run.real_domain),
        KINDS[kind].surface if KINDS[kind].aligned else None,
    )  # fmt: skip
    frames = RunFrames(store, run, stage.kept(store.path))
    poses = np.stack([store.instances.x, store.instances.y, store.instances.heading], axis=1)
    maps = {spec: map_geometry.MapGrid(store.dataset.bounds) for spec in unit.missing}
    for start in range(0, valid.size, _READ_ROWS):
        stop = min(start + _READ_ROWS, valid.size)
        rows = np.flatnonzero(valid[start:stop])
        if not rows.size:
            continue
        depth = _depth(frames, floor_heat, side, other, slice(start, stop), rows)
        for spec, target in maps.items():
            heat = _heat(stage.source, store, kind, side, spec.mode, start, stop)[rows]
            ray = KINDS[kind].ray(spec.mode)
            floor_heat.add(target, heat, depth, poses[start:stop][rows], ray)
    return {spec: target.aggregates() for spec, target in maps.items()}


def _depth(
    frames: RunFrames, floor_heat: map_geometry.FloorHeat, own: Side, other: Side, span: slice,
    rows: NDArray[np.intp],
) -> NDArray[Any]:  # fmt: skip
    """Raw depth (k, H, W) of some of the instances of `span`, where their heat lies."""

    def read(side: Side) -> NDArray[Any]:
        return frames.read(side, span.start, span.stop, ("depth",))["depth"][rows]

    return floor_heat.depth(read(own), read(other) if floor_heat.needs_other else None)


def _heat(
    source: Any, store: Store, kind: str, side: Side, mode: str | None, start: int, stop: int
) -> NDArray[np.float32]:
    """Maps of iids [start, stop), shape (n, h, w), without the planes that are not asked for."""
    planes = KINDS[kind].planes
    array = source(store.path, kind, side, None if planes else mode)
    block = np.asarray(array[start:stop], dtype=np.float32)
    if block.ndim == 3:
        return block
    return np.ascontiguousarray(block[:, planes.index(mode) if planes else 0])
