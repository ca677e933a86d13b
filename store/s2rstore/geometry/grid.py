"""Heat on the floor: back-projection of heatmaps and their aggregation on a grid."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import camera
from s2rstore.records import Bounds, Domain

Ray = Literal["rgb", "depth"]

AGGREGATES = ("mean", "max", "sum", "count")
SAMPLES = 128
HEIGHTS = (0.1, 2.0)


class MapGrid:
    """Square cells over the bounds, `cells` on the longer side; row 0 lies at y0."""

    def __init__(self, bounds: Bounds, cells: int = 264) -> None:
        self.bounds = bounds
        self.size = max(bounds.width, bounds.height) / cells
        self.cols = max(1, round(bounds.width / self.size))
        self.rows = max(1, round(bounds.height / self.size))
        count = self.rows * self.cols
        self._sum = np.zeros(count)
        self._count = np.zeros(count)
        self._max = np.full(count, -np.inf)

    def cell(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
        """Flat cell index of each point, -1 outside the bounds."""
        col = np.floor((x - self.bounds.x0) / self.bounds.width * self.cols)
        row = np.floor((y - self.bounds.y0) / self.bounds.height * self.rows)
        with np.errstate(invalid="ignore"):
            inside = (col >= 0) & (col < self.cols) & (row >= 0) & (row < self.rows)
        return np.where(inside, np.where(inside, row * self.cols + col, 0), -1).astype(np.int64)

    def add(self, cells: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        """Accumulate values, shape (k,), in cells that lie inside."""
        count = self._count.size
        self._sum += np.bincount(cells, weights=values, minlength=count)
        self._count += np.bincount(cells, minlength=count)
        order = np.argsort(cells, kind="stable")
        cells, values = cells[order], values[order]
        if cells.size:
            starts = np.flatnonzero(np.diff(cells, prepend=-1))
            tops = np.maximum.reduceat(values, starts)
            hit = cells[starts]
            self._max[hit] = np.maximum(self._max[hit], tops)

    def aggregates(self) -> NDArray[np.float32]:
        """Shape (4, rows, cols) in the order of `AGGREGATES`; NaN where nothing fell, count 0."""
        empty = self._count == 0
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = self._sum / self._count
        planes = [mean, self._max, self._sum, self._count]
        made = np.stack([np.where(empty, np.nan, plane) for plane in planes[:3]] + [self._count])
        return made.reshape(4, self.rows, self.cols).astype(np.float32)


class Projector:
    """Back-projects heat of one domain's frames; ray tables are made once.

    Sampling is SAMPLES x SAMPLES depth pixels per frame. Heat of RGB origin is looked up where
    each depth ray falls in the RGB image; what that image does not see carries no heat.
    """

    def __init__(
        self,
        domain: Domain,
        frame: tuple[int, int],
        y_down: bool,
        heights: tuple[float, float] = HEIGHTS,
    ) -> None:
        """`frame` is the stored (height, width); `heights` above the floor that count, metres."""
        self._domain = domain
        self._y_down = y_down
        self._heights = heights
        self._rays = camera.rays(domain.depth, SAMPLES, SAMPLES, frame)
        self._row = np.floor(camera.sample_centres(SAMPLES, frame[0])).astype(np.intp)
        self._col = np.floor(camera.sample_centres(SAMPLES, frame[1])).astype(np.intp)
        u, v, self._seen = camera.into_rgb(self._rays, domain.rgb, frame)
        self._u, self._v = u / frame[1], v / frame[0]

    def lookup(self, shape: tuple[int, int], ray: Ray) -> NDArray[np.int64]:
        """Flat index into a heatmap of (rows, cols) for each depth sample; -1 where unseen."""
        if ray == "depth":
            share = (np.arange(SAMPLES) + 0.5) / SAMPLES
            rows = (share * shape[0]).astype(np.int64)[:, None]
            cols = (share * shape[1]).astype(np.int64)[None, :]
            return rows * shape[1] + cols
        rows = np.clip(np.floor(self._v * shape[0]), 0, shape[0] - 1)
        cols = np.clip(np.floor(self._u * shape[1]), 0, shape[1] - 1)
        return np.where(self._seen, rows * shape[1] + cols, -1).astype(np.int64)

    def points(
        self, depth: NDArray[np.uint8] | NDArray[np.uint16], poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Map x, y, height and validity of the sampled depth pixels, each (n, S, S).

        `depth` (n, H, W) raw values, `poses` (n, 3). Valid excludes heights out of range.
        """
        raw = depth[:, self._row[:, None], self._col[None, :]]
        record = self._domain
        valid = (raw >= record.depth_raw_min) & (raw <= record.depth_raw_max)
        metres = raw * np.float64(record.depth_scale)
        x, y, height = camera.to_floor(self._rays, metres, record, poses, self._y_down)
        valid &= (height >= self._heights[0]) & (height <= self._heights[1])
        return x, y, height, valid

    def project(
        self,
        heat: NDArray[np.float32],
        depth: NDArray[np.uint8] | NDArray[np.uint16],
        poses: NDArray[np.float64],
        ray: Ray,
        grid: MapGrid,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Cells and values of a batch's heat, each (k,).

        `heat` (n, h, w) of any size over the whole image, NaN = no value; `depth` (n, H, W);
        `poses` (n, 3).
        """
        x, y, _, valid = self.points(depth, poses)
        lookup = self.lookup((heat.shape[1], heat.shape[2]), ray)
        values = heat.reshape(len(heat), -1)[:, np.maximum(lookup, 0)]
        cells = grid.cell(x, y)
        keep = valid & (lookup >= 0)[None] & (cells >= 0) & np.isfinite(values)
        return cells[keep], values[keep].astype(np.float64)
