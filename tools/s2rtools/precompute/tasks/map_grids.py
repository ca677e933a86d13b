"""Map grids: every instance's heat back-projected on the floor and aggregated."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import floor_grid as map_geometry
from s2rstore.geometry.reprojection import HeatSurface
from s2rstore.reader import Store
from s2rstore.records import Run, Side
from s2rstore.run_inputs import run_domain
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.precompute.frame_reader import RunFrames
from s2rtools.precompute.stages import MAP_SETTINGS
from s2rtools.precompute.work_units import ArraySpec, WorkUnit

_READ_ROWS = 64


def grids(store: Store, run: Run, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """Mean, max, sum and count grids of one kind on one side, for each of its modes.

    Heat goes through that side's own valid depth and calibrated rays; for kinds that compare both
    views, through the aligned rays at the nearer of both surfaces.
    """
    stage = unit.stage
    side: Side = "sim" if stage.name.endswith(":sim") else "real"
    kind = stage.specs[0].kind.removeprefix("map:")
    valid = stage.valid(store.path)
    frame = store.dataset.frame_height, store.dataset.frame_width
    other: Side = "real" if side == "sim" else "sim"
    surface = HeatSurface(
        run_domain(store, run, side), run_domain(store, run, other), frame, side == "real",
        store.correction(run.sim_domain, run.real_domain),
        HEATMAP_KINDS[kind].surface if HEATMAP_KINDS[kind].aligned else None,
    )  # fmt: skip
    frames = RunFrames(store, run, stage.kept(store.path))
    poses = np.stack([store.instances.x, store.instances.y, store.instances.heading], axis=1)
    maps = {spec: map_geometry.MapGrid(store.dataset.bounds, MAP_SETTINGS["cells"])
            for spec in unit.missing}  # fmt: skip
    projector = map_geometry.Projector(
        surface.domain, frame, store.dataset.y_down,
        tuple(MAP_SETTINGS["heights"]),
    )  # fmt: skip
    for start in range(0, valid.size, _READ_ROWS):
        stop = min(start + _READ_ROWS, valid.size)
        rows = np.flatnonzero(valid[start:stop])
        if not rows.size:
            continue
        depth = _depth(frames, surface, side, other, slice(start, stop), rows)
        for spec, target in maps.items():
            heat = _heat(stage.source, store, kind, side, spec.mode, start, stop)[rows]
            ray = HEATMAP_KINDS[kind].ray(spec.mode)
            target.add(*projector.project(heat, depth, poses[start:stop][rows], ray, target))
    return {spec: target.aggregates() for spec, target in maps.items()}


def _depth(
    frames: RunFrames, surface: HeatSurface, own: Side, other: Side, span: slice,
    rows: NDArray[np.intp],
) -> NDArray[Any]:  # fmt: skip
    """Raw depth (k, H, W) of some of the instances of `span`, where their heat lies."""

    def read(side: Side) -> NDArray[Any]:
        return frames.read(side, span.start, span.stop, ("depth",))["depth"][rows]

    return surface.depth(read(own), read(other) if surface.needs_other else None)


def _heat(
    source: Any, store: Store, kind: str, side: Side, mode: str | None, start: int, stop: int
) -> NDArray[np.float32]:
    """Maps of iids [start, stop), shape (n, h, w), without the planes that are not asked for."""
    planes = HEATMAP_KINDS[kind].planes
    array = source(store.path, kind, side, None if planes else mode)
    block = np.asarray(array[start:stop], dtype=np.float32)
    if block.ndim == 3:
        return block
    return np.ascontiguousarray(block[:, planes.index(mode) if planes else 0])
