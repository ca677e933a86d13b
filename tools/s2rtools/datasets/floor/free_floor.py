"""The floor on which a robot can be: that of the synthetic world, or places near recorded poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.synthetic_world.dataset import WorldData
from s2rtools.synthetic_world.routes import CLEARANCE, FLOOR_CELL
from s2rtools.synthetic_world.world import World

Floats = NDArray[np.float64]
REACH = 0.6
"""Metres from a recorded pose within which the floor counts as free."""


@dataclass(frozen=True, slots=True)
class FreeFloor:
    """Where a robot can be: `is_free(points (n, 2), reach)` within `extent`, (2, 2) low and high.

    `reach` in metres matters where free floor is known by recorded poses only: it is the distance
    within which one counts. `world` is the synthetic world of the store, if it was made of one.
    `origin` says how free floor is known, in one phrase.
    """

    extent: Floats
    is_free: Callable[[Floats, float], NDArray[np.bool_]]
    world: World | None
    origin: str

    @classmethod
    def of_store(cls, store: Store, command: str) -> FreeFloor:
        """Raises RequestError, which names `command`, where the store has no poses."""
        store.require_poses(command)
        data = WorldData.of_store(store)
        if data is not None:
            return cls.of_world(data.world)
        recorded = _recorded_places(store)
        if not len(recorded):
            raise RequestError(f"{store.path}: no instance has a position; {command} needs them")
        tree = KDTree(recorded)

        def is_free(points: Floats, reach: float) -> NDArray[np.bool_]:
            return np.isfinite(tree.query(points, distance_upper_bound=max(REACH, reach))[0])

        extent = np.array([recorded.min(axis=0) - REACH, recorded.max(axis=0) + REACH])
        return cls(extent, is_free, None, f"places within {REACH:g} m of recorded poses")

    @classmethod
    def of_world(cls, world: World) -> FreeFloor:
        """The floor of a synthetic world that is free on both sides."""
        size = len(world.floor.clearance) * FLOOR_CELL
        return cls(
            np.array([[0.0, 0.0], [size, size]]), lambda points, reach: is_free(world, points),
            world, "free floor of the synthetic world",
        )  # fmt: skip

    def grid(self, spacing: float, most: int) -> Floats:
        """Centres (P, 2) of square cells of `spacing` metres that are free.

        Raises RequestError for a grid of more than `most` cells.
        """
        low = np.floor(self.extent[0] / spacing) * spacing
        sizes = np.ceil((self.extent[1] - low) / spacing)
        if np.prod(sizes) > most:
            raise RequestError(f"a grid of {spacing:g} m has more than {most:,} cells")
        x, y = (low[k] + (np.arange(int(sizes[k])) + 0.5) * spacing for k in (0, 1))
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return points[self.is_free(points, 0.75 * spacing)]


def _recorded_places(store: Store) -> Floats:
    """Positions (n, 2) where real images were taken; without any, those of the first ingest.

    Rendered poses do not count: they say nothing about where a robot can be.
    """
    real = [name for name in store.domains if store.domain(name).kind == "real"]
    counts = np.zeros(len(store.instances), dtype=np.bool_)
    for name in real:
        counts |= store.imaged(name)
    if not counts.any():
        counts[: store.parts[0].stop] = True
    places = np.column_stack([store.instances.x, store.instances.y])[counts]
    return places[np.isfinite(places).all(axis=1)]


def is_free(world: World, points: Floats) -> NDArray[np.bool_]:
    """Whether a robot has room at each position (n, 2) of a synthetic world."""
    clearance = world.floor.clearance
    column, row = np.floor(points / FLOOR_CELL).astype(np.intp).T
    inside = (row >= 0) & (column >= 0) & (row < clearance.shape[0]) & (column < clearance.shape[1])
    free = np.zeros(len(points), dtype=np.bool_)
    free[inside] = clearance[row[inside], column[inside]] >= CLEARANCE
    return free


def turns(headings: int) -> Floats:
    """Evenly spread headings (n,), radians from -pi."""
    return np.linspace(-math.pi, math.pi, headings, endpoint=False)
