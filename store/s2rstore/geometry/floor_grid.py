"""Heat on the floor: back-projection of heatmaps and their aggregation on a grid."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import camera
from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.geometry.reprojection import HeatSurface
from s2rstore.records import Bounds, Dataset, Domain, Side

Ray = Literal["rgb", "depth"]

AGGREGATES = ("mean", "max", "sum", "count")
SAMPLES = 128
"""Depth pixels per frame that are back-projected, along each axis."""
CELLS = 264
"""Cells on the longer side of a map grid."""
HEIGHTS = (0.1, 2.0)
"""Metres above the floor between which points count."""


class MapGrid:
    """Square cells over the bounds, `cells` on the longer side; row 0 lies at y0."""

    def __init__(self, bounds: Bounds, cells: int = CELLS) -> None:
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
        col = (x - self.bounds.x0) * (self.cols / self.bounds.width)
        row = (y - self.bounds.y0) * (self.rows / self.bounds.height)
        inside = (col >= 0) & (col < self.cols) & (row >= 0) & (row < self.rows)
        with np.errstate(invalid="ignore"):
            flat = row.astype(np.int64) * self.cols + col.astype(np.int64)
        return np.where(inside, flat, -1)

    def add(self, cells: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        """Accumulate values, shape (k,), in cells that lie inside."""
        np.add.at(self._sum, cells, values)
        np.add.at(self._count, cells, 1.0)
        np.maximum.at(self._max, cells, values)

    def aggregates(self) -> NDArray[np.float32]:
        """Shape (4, rows, cols) in the order of `AGGREGATES`; NaN where nothing fell, count 0."""
        empty = self._count == 0
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = self._sum / self._count
        planes = [mean, self._max, self._sum, self._count]
        stacked = np.stack([np.where(empty, np.nan, plane) for plane in planes[:3]] + [self._count])
        return stacked.reshape(4, self.rows, self.cols).astype(np.float32)


def merged_aggregate(
    grids: Sequence[Mapping[str, NDArray[np.float32]]], aggregate: str
) -> NDArray[np.float32]:
    """Merge the map grids of several parts of a data set into one aggregate, (rows, cols).

    Each of `grids` maps the names in `AGGREGATES` to arrays of `MapGrid.aggregates`.
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


def merge_partial_grids(grids: Iterable[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Merge arrays (4, rows, cols) of `MapGrid.aggregates` over different instances into one."""
    total = highest = count = None
    for grid in grids:
        _, largest, added, number = grid.astype(np.float64)
        if total is None or highest is None or count is None:
            total, highest, count = np.nan_to_num(added), largest, number
        else:
            total, highest = total + np.nan_to_num(added), np.fmax(highest, largest)
            count = count + number
    if total is None or highest is None or count is None:
        raise ValueError("no grids")
    with np.errstate(invalid="ignore", divide="ignore"):
        planes = [total / count, highest, total]
    stacked = [np.where(count == 0, np.nan, plane) for plane in planes]
    return np.stack([*stacked, count]).astype(np.float32)


class Projector:
    """Back-projects heat of one domain's frames; ray tables are computed once.

    Sampling is SAMPLES x SAMPLES depth pixels per frame, each along the ray through its centre.
    Heat of RGB origin is looked up where each depth ray falls in the RGB image; what that image
    does not see carries no heat.
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
        rows, cols = (camera.sample_pixels(SAMPLES, extent) for extent in frame)
        self._pixels = (rows[:, None] * frame[1] + cols[None, :]).ravel()
        v, u = rows + np.float64(0.5), cols + np.float64(0.5)
        self._rays = camera.rays(domain.depth, v, u)
        self._low, self._high = _raw_range(self._rays.up.ravel(), domain, heights)
        self._shares = v / frame[0], u / frame[1]
        u, v, self._visible = camera.into_rgb(self._rays, domain.rgb, frame)
        self._u, self._v = u / frame[1], v / frame[0]
        self._lookups: dict[tuple[int, int, Ray], _Lookup] = {}

    def lookup(self, shape: tuple[int, int], ray: Ray) -> NDArray[np.int64]:
        """Flat index into a heatmap of (rows, cols) for each depth sample; -1 where not visible."""
        if ray == "depth":
            across = (self._shares[1] * shape[1]).astype(np.int64)
            return (self._shares[0] * shape[0]).astype(np.int64)[:, None] * shape[1] + across
        rows = np.clip(np.floor(self._v * shape[0]), 0, shape[0] - 1)
        cols = np.clip(np.floor(self._u * shape[1]), 0, shape[1] - 1)
        return np.where(self._visible, rows * shape[1] + cols, -1).astype(np.int64)

    def points(
        self, depth: NDArray[np.uint8] | NDArray[np.uint16], poses: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Map x, y, height and validity of the sampled depth pixels, each (n, S, S).

        `depth` (n, H, W) raw values, `poses` (n, 3). Valid excludes heights out of range.
        """
        raw = depth.reshape(len(depth), -1)[:, self._pixels]
        valid = (raw >= self._low) & (raw <= self._high)
        shape = len(depth), SAMPLES, SAMPLES
        metres = raw.reshape(shape) * np.float64(self._domain.depth_scale)
        x, y, height = camera.to_floor(self._rays, metres, self._domain, poses, self._y_down)
        return x, y, height, valid.reshape(shape)

    def project(
        self,
        heat: NDArray[np.float32],
        depth: NDArray[np.uint8] | NDArray[np.uint16],
        poses: NDArray[np.float64],
        ray: Ray,
        grid: MapGrid,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Cells and values of the heat of a batch, each (k,).

        `heat` (n, h, w) of any size over the whole image, NaN = no value; `depth` (n, H, W);
        `poses` (n, 3). One image at a time stays in the processor's cache.
        """
        lookup = self._visible_lookup((heat.shape[1], heat.shape[2]), ray)
        flat = heat.reshape(len(heat), heat.shape[1] * heat.shape[2])
        parts = [self._one(*item, lookup, grid) for item in zip(flat, depth, poses, strict=True)]
        if not parts:
            return np.empty(0, np.int64), np.empty(0)
        cells, values = zip(*parts, strict=True)
        return np.concatenate(cells), np.concatenate(values)

    def _one(
        self,
        heat: NDArray[np.float32],
        depth: NDArray[np.uint8] | NDArray[np.uint16],
        pose: NDArray[np.float64],
        lookup: _Lookup,
        grid: MapGrid,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Cells and values of one image: heat (h * w,), depth (H, W), pose (3,)."""
        raw = depth.reshape(-1)[lookup.pixels]
        picked = np.flatnonzero((raw >= lookup.low) & (raw <= lookup.high))
        values = heat[lookup.cells[picked]].astype(np.float64)
        metres = raw[picked] * np.float64(self._domain.depth_scale)
        forward = metres * lookup.forward[picked] + self._domain.forward_offset
        right = metres * lookup.right[picked] * (1.0 if self._y_down else -1.0)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        cells = grid.cell(
            pose[0] + forward * cos - right * sin, pose[1] + forward * sin + right * cos
        )
        keep = (cells >= 0) & np.isfinite(values)
        return cells[keep], values[keep]

    def _visible_lookup(self, shape: tuple[int, int], ray: Ray) -> _Lookup:
        """The samples that can carry heat of this shape."""
        key = *shape, ray
        if key not in self._lookups:
            cells = self.lookup(shape, ray).ravel()
            visible = np.flatnonzero((cells >= 0) & (self._low <= self._high))
            self._lookups[key] = _Lookup(
                self._pixels[visible], self._low[visible], self._high[visible], cells[visible],
                self._rays.right.ravel()[visible], self._rays.forward.ravel()[visible],
            )  # fmt: skip
        return self._lookups[key]


@dataclass(frozen=True, slots=True, eq=False)
class _Lookup:
    """Per depth sample (m,): its pixel, the raw values that count, its heat cell, its ray."""

    pixels: NDArray[np.intp]
    low: NDArray[np.uint16]
    high: NDArray[np.uint16]
    cells: NDArray[np.int64]
    right: NDArray[np.float64]
    forward: NDArray[np.float64]


class FloorHeat(HeatSurface):
    """Lays heatmaps of one side of a run on the floor.

    The only way from heatmaps to map grids: precomputed grids, grids of selected instances and of
    live results, all with `CELLS` and `HEIGHTS`.
    """

    def __init__(
        self, view: Domain, other: Domain, dataset: Dataset, side: Side,
        rig_offset: RigOffset | None, surface: str | None,
    ) -> None:  # fmt: skip
        """`view` is the domain of `side`, `other` that of the other side; see `HeatSurface`."""
        frame = dataset.frame_height, dataset.frame_width
        super().__init__(view, other, frame, side == "real", rig_offset, surface)
        self._projector = _projector(_DomainKey(self.domain), frame, dataset.y_down)

    def add(
        self,
        grid: MapGrid,
        heat: NDArray[np.float32],
        depth: NDArray[Any],
        poses: NDArray[np.float64],
        ray: Ray,
    ) -> None:
        """Add heat (n, h, w) at `depth` (n, H, W), taken at `poses` (n, 3), to a grid."""
        grid.add(*self._projector.project(heat, depth, poses, ray, grid))


class _DomainKey:
    """A domain as a cache key, compared by content."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain

    def __hash__(self) -> int:
        return hash(self.domain.domain)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _DomainKey) and other.domain == self.domain


@lru_cache(maxsize=8)
def _projector(key: _DomainKey, frame: tuple[int, int], y_down: bool) -> Projector:
    return Projector(key.domain, frame, y_down)


def _raw_range(
    up: NDArray[np.float64], domain: Domain, heights: tuple[float, float]
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """The valid raw depths that put each ray's point between the heights; low > high for none.

    Height is linear in depth along a ray, so that a band of heights is a range of raw values.
    """
    rise = up * domain.depth_scale
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(height - domain.camera_height) / rise for height in heights])
    level = rise == 0
    inside = heights[0] <= domain.camera_height <= heights[1]
    first = np.where(level, 0.0 if inside else np.inf, ends.min(axis=0))
    last = np.where(level, np.inf if inside else -np.inf, ends.max(axis=0))
    low = np.clip(np.ceil(first), domain.depth_raw_min, domain.depth_raw_max)
    high = np.clip(np.floor(last), domain.depth_raw_min, domain.depth_raw_max)
    none = (first > domain.depth_raw_max) | (last < domain.depth_raw_min)
    return np.where(none, 1, low).astype(np.uint16), np.where(none, 0, high).astype(np.uint16)
