"""Where the labelled objects are: per view and on the floor, rendered again from the recipe."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.grid import MapGrid, Projector
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain, Side
from s2rtools.world.dataset import WorldData

CELLS = 32
SHARE = 0.25
_BATCH = 64

Plane = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What one side's true camera sees, of either scene: ids (N, h, w) of labelled objects, 0 for
    the rest; `depth` (N, h, w) is the raw true depth of the side's own scene.
    """

    sim: NDArray[np.int16]
    real: NDArray[np.int16]
    depth: NDArray[np.uint16]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(N, h, w): the union of both scenes' labelled objects."""
        return (self.sim > 0) | (self.real > 0)

    def own(self, side: Side) -> NDArray[np.bool_]:
        return (self.sim if side == "sim" else self.real) > 0


class Truth:
    """The labelled changes of a store's world, as each instance sees them.

    Raises RequestError for a store that is not of a world.
    """

    def __init__(self, store: Store) -> None:
        data = WorldData.of_store(store)
        if data is None:
            raise RequestError(f"{store.path}: no truth is known; `s2r ingest world` makes data "
                               "whose truth is")  # fmt: skip
        self.store, self.data = store, data
        columns = store.instances
        self.poses = np.stack([columns.x, columns.y, columns.heading], axis=1)
        first = {t.trajectory: store.first_iid(t.trajectory) for t in store.trajectories}
        self.numbers = np.empty(len(columns), dtype=np.intp)
        names = data.names
        for iid in range(len(columns)):
            name = columns.trajectory_names[int(columns.trajectory[iid])]
            self.numbers[iid] = 1_000_000 * names.index(name) + iid - first[name]
        self._floors: dict[tuple[Side, tuple[int, int]], tuple[Plane, Plane]] = {}
        self.changed = data.world.changed(data.severities("real"))

    @cached_property
    def seen(self) -> dict[Side, Seen]:
        return {side: self._seen(side) for side in SIDES}

    def _seen(self, side: Side) -> Seen:
        camera = self.data.camera(side)
        ids: dict[Side, list[NDArray[np.int16]]] = {"sim": [], "real": []}
        depths = []
        for start in range(0, len(self.poses), _BATCH):
            poses = self.poses[start : start + _BATCH]
            for scene in SIDES:
                views = self.data.renderer(scene).render(poses, camera, samples=0)
                labelled = np.isin(views.identity, self.changed)
                ids[scene].append(np.where(labelled, views.identity, 0).astype(np.int16))
                if scene == side:
                    depths.append(self.data.raw(views))
        sim, real = (np.concatenate(ids[scene]) for scene in SIDES)
        return Seen(sim, real, np.concatenate(depths))

    @cached_property
    def cells(self) -> dict[Side, NDArray[np.bool_]]:
        """(N, CELLS, CELLS): cells of the image that labelled objects cover by a quarter."""
        return {
            side: np.asarray(to_cells(self.seen[side].mask.astype(np.float32)) >= SHARE)
            for side in SIDES
        }

    def floor(self, side: Side, shape: tuple[int, int]) -> tuple[Plane, Plane]:
        """Samples of labelled objects and of everything per floor cell, each (rows, columns).

        Through the true depth and the true camera of a side's own scene.
        """
        key = side, shape
        if key not in self._floors:
            self._floors[key] = self._floor(side, shape)
        return self._floors[key]

    def _floor(self, side: Side, shape: tuple[int, int]) -> tuple[Plane, Plane]:
        seen = self.seen[side]
        dataset = self.store.dataset
        domain = self._true_domain(side)
        grid = MapGrid(dataset.bounds, max(shape))
        projector = Projector(domain, seen.depth.shape[1:], dataset.y_down)
        heat = seen.own(side).astype(np.float32)
        grid.add(*projector.project(heat, seen.depth, self.poses, "rgb", grid))
        planes = grid.aggregates()
        return np.nan_to_num(planes[2]), planes[3]

    def _true_domain(self, side: Side) -> Domain:
        camera = self.data.camera(side)
        declared = self.store.domains[side]
        return Domain(
            declared.domain, side, camera.lens, camera.lens, camera.height, camera.forward_offset,
            declared.depth_scale, declared.depth_raw_min, declared.depth_raw_max,
        )  # fmt: skip


def to_cells(heat: NDArray[np.float32]) -> NDArray[np.float32]:
    """Maps (n, h, w) on the common grid (n, CELLS, CELLS): area means of what has a value.

    A coarser map's value counts for every cell that its own cell covers.
    """
    height, width = heat.shape[1:]
    rows, cols = _overlaps(height), _overlaps(width)
    known = np.isfinite(heat)
    values = np.where(known, heat, 0).astype(np.float64)
    made = [rows @ plane @ cols.T for plane in (values, known.astype(np.float64))]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(made[1] > 1e-9, made[0] / made[1], np.nan).astype(np.float32)


def _overlaps(extent: int) -> NDArray[np.float64]:
    """(CELLS, extent): the share of each common cell that each own cell covers."""
    edges = np.linspace(0, extent, CELLS + 1)
    own = np.arange(extent)
    low = np.maximum(edges[:-1, None], own[None])
    high = np.minimum(edges[1:, None], own[None] + 1)
    return np.maximum(high - low, 0.0) * CELLS / extent
