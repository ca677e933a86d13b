"""Routes of the robot: shortest paths with clearance, sampled as poses with informative views."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from s2rstore.geometry import angles

Poses = NDArray[np.float64]
HasContent = Callable[[Poses], NDArray[np.bool_]]

FLOOR_CELL = 0.1
CLEARANCE = 0.26
ROBOT_HEIGHT = 1.0
"""Metres; parts that hang higher are not obstacles."""
_COMFORT = 0.45
_TURN = math.radians(22)


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values whose last digits, which differ between processors, decide on nothing."""
    return np.round(values, 6)


def clearance(taken: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of every cell to the nearest occupied cell, metres."""
    return np.asarray(ndimage.distance_transform_edt(~taken) * FLOOR_CELL)


class DrivableFloor:
    """Free space of a building on a grid of 0.1 m, with routes through it."""

    def __init__(self, taken: NDArray[np.bool_]) -> None:
        """`taken` [y, x] marks cells that are occupied on either side."""
        self.clearance = clearance(taken)
        self.free = self.clearance >= CLEARANCE
        self._cells = taken.shape[0]
        self._graph = self._edges()

    def _edges(self) -> sparse.csr_matrix:
        n = self._cells
        cost = _rounded(1.0 + 6.0 * np.exp(-self.clearance / _COMFORT))
        index = np.arange(n * n).reshape(n, n)
        rows, cols, weights = [], [], []
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            a = index[: n - dy, max(0, -dx) : n - max(0, dx)]
            b = index[dy:, max(0, dx) : n - max(0, -dx)]
            both = self.free.flat[a.ravel()] & self.free.flat[b.ravel()]
            length = math.hypot(dx, dy)
            mean = (cost.flat[a.ravel()] + cost.flat[b.ravel()]) * 0.5 * length
            rows.append(a.ravel()[both])
            cols.append(b.ravel()[both])
            weights.append(mean[both])
        joined = tuple(np.concatenate(part) for part in (weights, rows, cols))
        return sparse.csr_matrix((joined[0], (joined[1], joined[2])), shape=(n * n, n * n))

    def most_open_point(self, x0: float, y0: float, x1: float, y1: float) -> tuple[float, float]:
        """The point of a rectangle with the largest clearance, metres."""
        rows = slice(round(y0 / FLOOR_CELL), round(y1 / FLOOR_CELL))
        cols = slice(round(x0 / FLOOR_CELL), round(x1 / FLOOR_CELL))
        clear = self.clearance[rows, cols]
        i, j = np.unravel_index(clear.argmax(), clear.shape)
        return (cols.start + int(j) + 0.5) * FLOOR_CELL, (rows.start + int(i) + 0.5) * FLOOR_CELL

    def route(self, stops: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
        """A smooth polyline (k, 2) through all reachable stops, metres."""
        legs: list[int] = []
        current = self._index(stops[0])
        for stop in stops[1:]:
            target = self._index(stop)
            length, before = csgraph.dijkstra(
                self._graph, directed=False, indices=current, return_predecessors=True
            )
            if not np.isfinite(length[target]):
                continue
            cells = [target]
            while cells[-1] != current:
                cells.append(int(before[cells[-1]]))
            legs += cells[::-1][1 if legs else 0 :]
            current = target
        at = np.array(legs)
        line = np.stack(
            [(at % self._cells + 0.5) * FLOOR_CELL, (at // self._cells + 0.5) * FLOOR_CELL], axis=1
        )
        return self._smooth(line)

    def _index(self, point: tuple[float, float]) -> int:
        """The free cell nearest to a point."""
        rows, cols = np.nonzero(self.free)
        distance = _rounded(
            np.hypot((cols + 0.5) * FLOOR_CELL - point[0], (rows + 0.5) * FLOOR_CELL - point[1])
        )
        best = int(distance.argmin())
        return int(rows[best]) * self._cells + int(cols[best])

    def _smooth(self, line: NDArray[np.float64]) -> NDArray[np.float64]:
        """Round the corners where the rounded path stays in free space."""
        rounded = ndimage.gaussian_filter1d(line, 4.0, axis=0, mode="nearest")
        i, j = (
            np.clip((rounded[:, k] / FLOOR_CELL).astype(int), 0, self._cells - 1) for k in (1, 0)
        )
        safe = ndimage.binary_erosion(self.free[i, j], iterations=3, border_value=1)
        weight = ndimage.uniform_filter1d(safe.astype(float), 7)[:, None]
        return weight * rounded + (1 - weight) * line

    def samples(self, rng: np.random.Generator, count: int, has_content: HasContent) -> Poses:
        """Random poses (count, 3) in free space whose views have content."""
        rows, cols = np.nonzero(self.clearance >= CLEARANCE)
        accepted: list[Poses] = []
        while sum(map(len, accepted)) < count:
            pick = rng.integers(len(rows), size=count)
            x = (cols[pick] + rng.random(count)) * FLOOR_CELL
            y = (rows[pick] + rng.random(count)) * FLOOR_CELL
            poses = np.stack([x, y, rng.uniform(-math.pi, math.pi, count)], axis=1)
            accepted.append(poses[has_content(poses)])
        return np.concatenate(accepted)[:count]


def drive_along(
    line: NDArray[np.float64], rng: np.random.Generator, count: int, has_content: HasContent
) -> Poses:
    """At most `count` poses (n, 3) along a polyline, in order.

    The robot looks ahead along the path, sways a little, turns on the spot at sharp bends, and
    leaves out views without content.
    """
    step = _rounded(np.hypot(*np.diff(line, axis=0).T))
    way = np.concatenate([[0.0], np.cumsum(step)])
    dense = np.arange(0.0, way[-1], 0.02)
    x, y = (np.interp(dense, way, line[:, k]) for k in (0, 1))
    ahead = np.minimum(np.arange(len(dense)) + 45, len(dense) - 1)
    back = np.maximum(ahead - 45, 0)
    heading = np.unwrap(np.arctan2(y[ahead] - y[back], x[ahead] - x[back]))
    heading = ndimage.gaussian_filter1d(heading, 8)
    sway = np.radians(9) * np.sin(dense * 1.3 + rng.uniform(0, 6.28))
    poses = _rounded(np.stack([x, y, angles.wrap(heading + sway)], axis=1))[:-45]
    turning = np.abs(np.diff(np.unwrap(poses[:, 2]), prepend=poses[0, 2])) / _TURN
    clock = np.cumsum(0.02 / 0.25 + turning)
    if len(poses) < 2:
        return poses[has_content(poses)]
    # Poses whose views have content, evenly spaced in driving time.
    keep = np.flatnonzero(has_content(poses[::3])) * 3
    at = np.interp(np.linspace(0, len(keep) - 1, count), np.arange(len(keep)), clock[keep])
    nearest = np.clip(np.searchsorted(clock[keep], at), 0, len(keep) - 1)
    return poses[np.unique(keep[nearest])]
