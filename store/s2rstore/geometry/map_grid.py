"""Map grids: heat per cell of the floor, its aggregates, and how those of several parts merge.

Totals of a set of instances are an array (3, rows, cols) of float64 in the order of `TOTALS`. They
are computed for any range of instances, merged, and turned into `AGGREGATES` once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds

AGGREGATES = ("mean", "max", "sum", "count")
TOTALS = ("max", "sum", "count")
CELLS = 264
"""Cells on the longer side of a map grid."""


class MapGrid:
    """Square cells over the bounds, `cells` on the longer side; row 0 lies at y0."""

    def __init__(self, bounds: Bounds, cells: int = CELLS) -> None:
        self.bounds = bounds
        self.size = max(bounds.width, bounds.height) / cells
        self.cols = max(1, round(bounds.width / self.size))
        self.rows = max(1, round(bounds.height / self.size))
        self._totals = empty_totals(self.rows, self.cols)
        self._max, self._sum, self._count = self._totals.reshape(len(TOTALS), -1)

    def locate(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Whether each point lies in the bounds, and its flat cell index, undefined outside."""
        col = (x - self.bounds.x0) * (self.cols / self.bounds.width)
        row = (y - self.bounds.y0) * (self.rows / self.bounds.height)
        inside = (col >= 0) & (col < self.cols) & (row >= 0) & (row < self.rows)
        with np.errstate(invalid="ignore"):
            return inside, row.astype(np.int64) * self.cols + col.astype(np.int64)

    def add(self, cells: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        """Accumulate finite values, shape (k,), in cells that lie inside."""
        np.add.at(self._sum, cells, values)
        np.add.at(self._count, cells, 1.0)
        np.maximum.at(self._max, cells, values)

    def totals(self) -> NDArray[np.float64]:
        """The totals of what was added, shape (3, rows, cols); not a copy."""
        return self._totals

    def aggregates(self) -> NDArray[np.float32]:
        """Shape (4, rows, cols) in the order of `AGGREGATES`; NaN where nothing fell, count 0."""
        return aggregates(self._totals)


def empty_totals(rows: int, cols: int) -> NDArray[np.float64]:
    """The totals of no instances: maximum -inf, sum and count 0."""
    totals = np.zeros((len(TOTALS), rows, cols))
    totals[0] = -np.inf
    return totals


def add_totals(totals: NDArray[np.float64], part: NDArray[np.float64]) -> None:
    """Add the totals of further instances, (3, rows, cols), in place."""
    np.maximum(totals[0], part[0], out=totals[0])
    totals[1:] += part[1:]


def aggregates(totals: NDArray[np.float64]) -> NDArray[np.float32]:
    """Shape (4, rows, cols) in the order of `AGGREGATES`; NaN where nothing fell, count 0."""
    largest, total, count = totals
    planes = np.empty((len(AGGREGATES), *count.shape), dtype=np.float32)
    with np.errstate(invalid="ignore"):
        np.divide(total, count, out=planes[0], casting="same_kind")
    planes[1:] = largest, total, count
    np.copyto(planes[:3], np.nan, where=count == 0)
    return planes


def merged_aggregate(
    grids: Sequence[Mapping[str, NDArray[np.float32]]], aggregate: str
) -> NDArray[np.float32]:
    """Merge the published map grids of several parts of a data set into one aggregate.

    Gives shape (rows, cols). Each of `grids` maps the names in `AGGREGATES` to the arrays of
    `aggregates`.
    """
    if len(grids) == 1:
        return grids[0][aggregate]
    stacks = {name: np.stack([grid[name] for grid in grids]) for name in AGGREGATES}
    count = stacks["count"].sum(axis=0, dtype=np.float64)
    total = np.nansum(stacks["sum"], axis=0, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count
    planes = {"mean": mean, "max": np.fmax.reduce(stacks["max"]), "sum": total}
    if aggregate == "count":
        return np.asarray(count, dtype=np.float32)
    return np.asarray(np.where(count == 0, np.nan, planes[aggregate]), dtype=np.float32)
