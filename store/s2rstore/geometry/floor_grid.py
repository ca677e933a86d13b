"""Back-project heatmaps onto the floor and add them to the cells of a map grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import camera
from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.geometry.map_grid import MapGrid
from s2rstore.geometry.reprojection import NearerSurface, heat_surface
from s2rstore.records import Dataset, Domain, Side

Ray = Literal["rgb", "depth"]

SAMPLES = 128
"""Depth pixels per frame that are back-projected, along each axis."""
HEIGHTS = (0.1, 2.0)
"""Metres above the floor between which points count."""


HeatCells = Callable[[tuple[int, int], Ray], NDArray[np.int64]]
"""Flat index into a heatmap of shape (rows, cols) for each of the S x S samples of a frame.

-1 where the image of the ray's camera does not see the sample.
"""


class FloorSamples:
    """The depth samples of a batch of images that lie on a map grid, for heat of any kind.

    Cells are known once per image; heat of any resolution and ray is looked up from them.
    """

    def __init__(
        self,
        cells: Sequence[NDArray[np.int64]],
        samples: Sequence[NDArray[np.intp]],
        heat_cells: HeatCells,
        ray: Ray | None,
    ) -> None:
        """`cells` and `samples` (k,) per image: cells of the grid and numbers of the samples.

        Samples that heat of other rays than `ray` needs may be missing, none for None.
        """
        self._counts = [part.size for part in cells]
        self._cells = np.concatenate(cells) if cells else np.empty(0, np.int64)
        self._samples = np.concatenate(samples) if samples else np.empty(0, np.intp)
        self._heat_cells, self._ray = heat_cells, ray
        self._found: dict[
            tuple[tuple[int, int], Ray], tuple[NDArray[np.int64], NDArray[np.int64]]
        ] = {}

    def values(
        self, heat: NDArray[np.float32], ray: Ray
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Cells and finite values, each (k,), of heat (n, h, w) of any size over whole images.

        Raises ValueError if the samples were chosen for another ray.
        """
        if self._ray not in (None, ray):
            raise ValueError(f"heat of the {ray} ray at samples of the {self._ray} ray")
        cells, places = self._places((heat.shape[1], heat.shape[2]), ray)
        values = heat.reshape(-1).take(places).astype(np.float64)
        finite = np.isfinite(values)
        return (cells, values) if finite.all() else (cells[finite], values[finite])

    def _places(
        self, shape: tuple[int, int], ray: Ray
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Cells of the samples that see heat of this shape, and flat indices into (n, *shape)."""
        if (shape, ray) not in self._found:
            places = self._heat_cells(shape, ray).take(self._samples)
            seen = places >= 0
            if len(self._counts) > 1:
                starts = np.arange(len(self._counts)) * (shape[0] * shape[1])
                places += np.repeat(starts, self._counts)
            self._found[shape, ray] = (
                (self._cells, places) if seen.all() else (self._cells[seen], places[seen])
            )
        return self._found[shape, ray]


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
        self._samples: dict[Ray | None, FrameSamples] = {}
        self._lookups: dict[tuple[tuple[int, int], Ray], NDArray[np.int64]] = {}

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
        `poses` (n, 3).
        """
        samples = self.samples(ray)
        return self.floor_samples(samples, samples.of(depth), poses, grid).values(heat, ray)

    def samples(self, ray: Ray | None) -> FrameSamples:
        """The samples that can carry heat of a ray, or of any ray for None."""
        if ray not in self._samples:
            can_carry = self._low <= self._high
            if ray == "rgb":
                can_carry &= self._visible.ravel()
            numbers = np.flatnonzero(can_carry)
            self._samples[ray] = FrameSamples(
                numbers, self._pixels[numbers], self._low[numbers], self._high[numbers],
                self._rays.right.ravel()[numbers], self._rays.forward.ravel()[numbers], ray,
            )  # fmt: skip
        return self._samples[ray]

    def floor_samples(
        self, samples: FrameSamples, raw: NDArray[Any], poses: NDArray[np.float64], grid: MapGrid
    ) -> FloorSamples:
        """The samples of a batch that lie on the cells of a grid.

        `raw` (n, m) depth of `samples`, `poses` (n, 3). One image at a time stays in the
        processor's cache.
        """
        parts = [self._image_cells(samples, *item, grid) for item in zip(raw, poses, strict=True)]
        cells, numbers = zip(*parts, strict=True) if parts else ((), ())
        return FloorSamples(cells, numbers, self._heat_cells, samples.ray)

    def _image_cells(
        self, samples: FrameSamples, raw: NDArray[Any], pose: NDArray[np.float64], grid: MapGrid
    ) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        """Cells of one image and the numbers of their samples: raw (m,), pose (3,)."""
        picked = np.flatnonzero((raw >= samples.low) & (raw <= samples.high))
        metres = raw.take(picked) * np.float64(self._domain.depth_scale)
        forward = metres * samples.forward.take(picked) + self._domain.forward_offset
        right = metres * samples.right.take(picked) * (1.0 if self._y_down else -1.0)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        inside, cells = grid.locate(
            pose[0] + forward * cos - right * sin, pose[1] + forward * sin + right * cos
        )
        if not inside.all():
            cells, picked = cells[inside], picked[inside]
        return cells, samples.numbers.take(picked)

    def _heat_cells(self, shape: tuple[int, int], ray: Ray) -> NDArray[np.int64]:
        """Flat index into a heatmap of (rows, cols) for each of the S x S samples; -1 unseen."""
        if (shape, ray) not in self._lookups:
            if ray == "depth":
                rows, cols = (np.floor(self._shares[axis] * shape[axis]) for axis in (0, 1))
                cells = rows[:, None] * shape[1] + cols
            else:
                rows = np.clip(np.floor(self._v * shape[0]), 0, shape[0] - 1)
                cols = np.clip(np.floor(self._u * shape[1]), 0, shape[1] - 1)
                cells = np.where(self._visible, rows * shape[1] + cols, -1)
            self._lookups[shape, ray] = cells.ravel().astype(np.int64)
        return self._lookups[shape, ray]


@dataclass(frozen=True, slots=True, eq=False)
class FrameSamples:
    """Samples (m,) of a frame that some valid depth puts between the heights.

    Number of each among the S x S samples, its pixel, the raw values that count, its direction;
    `ray` names the camera whose image sees all of them, None where some are not seen by both.
    """

    numbers: NDArray[np.intp]
    pixels: NDArray[np.intp]
    low: NDArray[np.uint16]
    high: NDArray[np.uint16]
    right: NDArray[np.float64]
    forward: NDArray[np.float64]
    ray: Ray | None

    def of(self, depth: NDArray[Any]) -> NDArray[Any]:
        """The values (n, m) of images (n, H, W) at the samples."""
        flat = depth.reshape(len(depth), depth.shape[1] * depth.shape[2])
        return np.take(flat, self.pixels, axis=1)


class FloorHeat:
    """Lays heatmaps of one side of a run on the floor.

    The only way from heatmaps to map grids: precomputed grids, grids of selected instances and of
    live results, all with `CELLS` and `HEIGHTS`.
    """

    def __init__(
        self, view: Domain, other: Domain, dataset: Dataset, side: Side,
        rig_offset: RigOffset | None, surface: str | None, ray: Ray | None = None,
    ) -> None:  # fmt: skip
        """`view` is the domain of `side`, `other` that of the other side; see `heat_surface`.

        `ray` is that of all heat that is looked up, None where it differs.
        """
        frame = dataset.frame_height, dataset.frame_width
        domain, nearer_to = heat_surface(view, other, side == "real", rig_offset, surface)
        self._projector = _projector(_DomainKey(domain), frame, dataset.y_down)
        self._samples = self._projector.samples(ray)
        self._nearer = None
        if nearer_to is not None:
            self._nearer = NearerSurface(domain, nearer_to, frame, self._samples.pixels)

    @property
    def needs_other(self) -> bool:
        """Whether `samples` needs the images of the other rig."""
        return self._nearer is not None

    def samples(
        self,
        own: NDArray[Any],
        other: NDArray[Any] | None,
        poses: NDArray[np.float64],
        grid: MapGrid,
    ) -> FloorSamples:
        """The samples of images taken at `poses` (n, 3) that lie on the cells of a grid.

        `own` and `other` are the raw depth (n, h, w) of the side and of the other side. Raises
        ValueError without the other one where it is needed.
        """
        raw = self._samples.of(own)
        if self._nearer is not None:
            if other is None:
                raise ValueError("the nearer surface needs the depth of both sides")
            raw = self._nearer(raw, other)
        return self._projector.floor_samples(self._samples, raw, poses, grid)


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
