"""Task: map grids, the heat of every instance projected on the floor and aggregated.

`compute_grids` makes the totals of any range of instances in one pass over their images, for all
kinds, modes and sides; `merge_grids` turns the totals of all ranges into grids.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.floor_grid import HEIGHTS, FloorHeat
from s2rstore.geometry.map_grid import AGGREGATES, CELLS, MapGrid, add_totals, aggregates
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run, Side
from s2rstore.run_inputs import run_domain
from s2rtools.heatmaps import HEATMAP_KINDS, HeatmapKind
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.frame_reader import RunFrames
from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

STAGE = "maps"
"""Name of the stages of map grids."""
MAP_SETTINGS: dict[str, Any] = {"cells": CELLS, "heights": list(HEIGHTS), "version": 1}
RANGE_INSTANCES = 4096
"""Instances whose totals are computed at once."""
_READ_ROWS = 32
_OTHER: dict[Side, Side] = {"sim": "real", "real": "sim"}

Totals = dict[ArraySpec, NDArray[np.float64]]
_Source = tuple[str, str | None, str | None]


def map_stages(
    store: Store, keys: ArrayKeys, forward: Stage, others: Sequence[Stage]
) -> list[Stage]:
    """The stage of the map grids of every heatmap of some stages; none without heatmaps.

    Heat of a domain without depth is not projected.
    One stage for both sides and all kinds, because they read the same images.
    """
    grid = MapGrid(store.dataset.bounds)
    specs: list[ArraySpec] = []
    heat: list[ArraySpec] = []
    for stage in (forward, *others):
        for kind in dict.fromkeys(spec.kind for spec in stage.specs if spec.kind in HEATMAP_KINDS):
            of_kind = stage.specs_of_kind(kind)
            heat += of_kind
            specs += [
                _map_spec(spec, keys, forward.specs[0].key, side, mode, grid)
                for side in _projected_sides(store, store.run(forward.run), kind)
                for spec in of_kind
                if spec.side in (side, None)
                for mode in HEATMAP_KINDS[kind].planes or (spec.mode,)
            ]
    if not specs:
        return []
    sources = (*forward.specs_of_kind("prediction"), *heat, *forward.sources)
    iids = range(heat[0].first_iid, heat[0].first_iid + heat[0].rows)
    return [
        Stage(
            STAGE, forward.run, tuple(specs), RANGE_INSTANCES, sources, aggregated=iids,
            compute=compute_totals,
        )
    ]  # fmt: skip


def _projected_sides(store: Store, run: Run, kind: str) -> list[Side]:
    """The sides whose heat of a kind can be projected: those with depth, which it needs."""
    with_depth = [side for side in SIDES if store.domain(run.domain(side)).has_depth]
    return with_depth if len(with_depth) == len(SIDES) or not HEATMAP_KINDS[kind].aligned else []


def _map_spec(
    spec: ArraySpec, keys: ArrayKeys, prediction: str, side: str, mode: str | None, grid: MapGrid
) -> ArraySpec:
    kind = HEATMAP_KINDS[spec.kind]
    surface = {"surface": kind.surface} if kind.aligned else {}
    return ArraySpec(
        f"map:{spec.kind}", side, mode, (grid.rows, grid.cols), "float32",
        ("aggregate", "row", "column"), spec.unit,
        keys.map(spec.key, prediction, {**MAP_SETTINGS, **surface}),
        len(AGGREGATES), (("aggregates", ",".join(AGGREGATES)),), spec.first_iid,
    )  # fmt: skip


def merge_grids(
    parts: Iterable[Mapping[ArraySpec, NDArray[np.float64]]],
) -> dict[ArraySpec, NDArray[np.float32]]:
    """Mean, max, sum and count, (4, rows, cols), of the totals of several ranges of instances.

    Sums are added in the order of `parts`: pass the ranges in ascending order for equal results.
    Only the merged totals and one part are held at a time. Raises ValueError if the parts do not
    hold the same arrays.
    """
    merged: Totals = {}
    for part in parts:
        if merged and part.keys() != merged.keys():
            raise ValueError("the parts hold totals of different map grids")
        for spec, totals in part.items():
            if spec in merged:
                add_totals(merged[spec], totals)
            else:
                merged[spec] = totals.copy()
        del part  # freed before the next part is computed
    return {spec: aggregates(merged.pop(spec)) for spec in list(merged)}


def compute_totals(computer: UnitComputer, unit: WorkUnit) -> Totals:
    """The totals of a unit's instances."""
    run = computer.store.run(unit.stage.run)
    return compute_grids(computer.store, run, unit.stage, unit.instances, unit.missing)


def compute_grids(
    store: Store, run: Run, stage: Stage, instances: range, specs: Sequence[ArraySpec]
) -> Totals:
    """Totals (3, rows, cols) of the valid ones of `instances`, for each of `specs`.

    See `s2rstore.geometry.map_grid.TOTALS`. Each depth image and each heatmap is read once. The
    floor cells of an image are found once for each rig and surface, and used by all kinds, modes
    and resolutions. Heat is projected by the side's valid depth and calibrated rays; for kinds that
    compare both views, by the aligned rays at the surface that the kind declares.
    """
    grids = {spec: MapGrid(store.dataset.bounds) for spec in specs}
    surfaces = _floor_surfaces(store, run, specs)
    sides = {side for each in surfaces for side in each.sides}
    frames = RunFrames(store, run, stage.rendered_arrays(store.path))
    valid = stage.valid_instances(store.path, instances)
    poses = {side: store.poses(run.domain(side)) for side in sides}
    source = {spec: _heat_source(stage, spec) for spec in specs}
    arrays = {each: stage.source_array(store.path, *each) for each in set(source.values())}
    for start in range(instances.start, instances.stop, _READ_ROWS):
        stop = min(start + _READ_ROWS, instances.stop)
        rows = np.flatnonzero(valid[start - instances.start : stop - instances.start])
        if not rows.size:
            continue
        depth = {side: frames.read(side, start, stop, ("depth",))["depth"][rows] for side in sides}
        heat = {
            each: np.asarray(array[start:stop][rows], dtype=np.float32)
            for each, array in arrays.items()
        }
        for each in surfaces:
            own, other = depth[each.side], depth.get(_OTHER[each.side])
            grid = grids[each.specs[0]]
            of_side = poses[each.side][start:stop][rows]
            samples = each.floor_heat.samples(own, other, of_side, grid)
            for spec in each.specs:
                planes, ray = _plane(heat[source[spec]], spec), _kind(spec).ray(spec.mode)
                grids[spec].add(*samples.values(planes, ray))
    return {spec: grid.totals() for spec, grid in grids.items()}


@dataclass(frozen=True, slots=True)
class _FloorSurface:
    """The grids of one side whose heat lies on the same surface."""

    side: Side
    floor_heat: FloorHeat
    specs: tuple[ArraySpec, ...]

    @property
    def sides(self) -> tuple[Side, ...]:
        """The sides whose depth is needed."""
        return (self.side, _OTHER[self.side]) if self.floor_heat.needs_other else (self.side,)


def _floor_surfaces(store: Store, run: Run, specs: Sequence[ArraySpec]) -> list[_FloorSurface]:
    groups: dict[tuple[Side, str | None], list[ArraySpec]] = defaultdict(list)
    for spec in specs:
        kind = _kind(spec)
        side: Side = "sim" if spec.side == "sim" else "real"
        groups[side, kind.surface if kind.aligned else None].append(spec)
    rig_offset = store.rig_offset(run.sim_domain, run.real_domain)
    domains = {side: run_domain(store, run, side) for side in SIDES}
    return [
        _FloorSurface(
            side,
            FloorHeat(
                domains[side], domains[_OTHER[side]], store.dataset, side, rig_offset, surface
            ),
            tuple(group),
        )
        for (side, surface), group in groups.items()
    ]


def _kind(spec: ArraySpec) -> HeatmapKind:
    """The heatmap kind whose maps are aggregated in a map grid."""
    return HEATMAP_KINDS[spec.kind.removeprefix("map:")]


def _heat_source(stage: Stage, spec: ArraySpec) -> _Source:
    """Kind, side and mode of the heatmaps that a map grid is made of."""
    kind = _kind(spec)
    mode = None if kind.planes else spec.mode
    for source in stage.sources:
        if (source.kind, source.mode) == (kind.name, mode) and source.side in (spec.side, None):
            return kind.name, source.side, mode
    raise KeyError(f"stage {stage.name} has no heatmaps of {spec.kind} {spec.side} {spec.mode}")


def _plane(heat: NDArray[np.float32], spec: ArraySpec) -> NDArray[np.float32]:
    """The maps (n, h, w) of a grid's mode in heatmaps (n, h, w) or (n, planes, h, w)."""
    planes = _kind(spec).planes
    return heat if heat.ndim == 3 else heat[:, planes.index(str(spec.mode)) if planes else 0]
