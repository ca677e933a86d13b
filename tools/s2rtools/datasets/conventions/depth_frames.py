"""Some depth images of a data set with their poses, and the points above the floor in them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.errors import counted
from s2rstore.files import layout, safe_files
from s2rstore.geometry import camera
from s2rstore.geometry.floor_grid import HEIGHTS
from s2rstore.records import Bounds, Domain
from s2rtools.datasets.scan import InstanceRecord, Scan, StoredRecords, StoredTrajectory

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]

_SAMPLES = 48
"""Depth pixels along each axis of a frame."""
_BLOCK = 64
"""Records that are made together."""


@dataclass(frozen=True, slots=True)
class Order:
    """The pose of a trajectory that an image has: `rows` behind its own, or in reverse order."""

    rows: int = 0
    is_reversed: bool = False

    def row(self, row: int, count: int) -> int:
        """The row of the pose of an image in a trajectory of `count` rows, which is a circle."""
        return count - 1 - row if self.is_reversed else (row + self.rows) % count

    @property
    def finding(self) -> str:
        """How data looks for which this order is right."""
        if self.is_reversed:
            return "poses look listed in reverse order"
        return f"numbering of poses looks shifted by {abs(self.rows)}"

    def __str__(self) -> str:
        if self.is_reversed:
            return "poses in reverse order"
        where = "behind" if self.rows > 0 else "before"
        return f"the pose {counted(abs(self.rows), 'row')} {where} that of the image"


DECLARED_ORDER = Order()


@dataclass(frozen=True, slots=True, eq=False)
class DepthFrames:
    """Samples of depth images of a domain.

    `raw` (n, r, c) are the raw values of images of (height, width) `size` at `r` by `c` pixels that
    are evenly spread. `poses` (n, 3) are x, y in metres and heading in radians, `orders` those that
    the frames would have in other orders.
    """

    domain: Domain
    raw: NDArray[Any]
    size: tuple[int, int]
    poses: Floats
    y_down: bool
    orders: Mapping[Order, Floats] = field(default_factory=dict)

    @classmethod
    def of(
        cls, domain: Domain, depth: Sequence[NDArray[Any]], poses: Floats, y_down: bool
    ) -> DepthFrames:
        """Samples of images (n, h, w) of one size; at least one."""
        raw = np.stack([image[sampled_grid(image.shape)] for image in depth])
        return cls(domain, raw, depth[0].shape, poses, y_down)


def sampled_grid(size: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows (r, 1) and columns (1, c) of the sampled pixels of images of (height, width)."""
    rows, cols = (camera.sample_pixels(min(_SAMPLES, extent), extent) for extent in size)
    return rows[:, None], cols[None, :]


@dataclass(frozen=True, slots=True)
class StoredRow:
    """A stored instance: its trajectory, its row in the arrays of frames, and its record."""

    trajectory: str
    row: int
    record: InstanceRecord
    stored: StoredTrajectory

    @property
    def pose(self) -> Pose:
        return self.record.x, self.record.y, self.record.heading

    def at(self, row: int) -> StoredRow:
        """Another instance of the trajectory."""
        return StoredRow(self.trajectory, row, self.stored.records(row, row + 1)[0], self.stored)

    def pose_in(self, domain: str) -> Pose:
        """The pose of the frame of a domain, which in a loose pair is another one."""
        own = self.record.frame_poses.get(domain)
        return self.pose if own is None else (own.x, own.y, own.heading)


def stored_rows(stored: StoredRecords) -> Iterator[StoredRow]:
    """All stored instances, by trajectory name, in recording order."""
    for name in sorted(stored):
        for start in range(0, len(stored[name]), _BLOCK):
            records = stored[name].records(start, start + _BLOCK)
            for row, record in enumerate(records, start):
                yield StoredRow(name, row, record, stored[name])


def spread_rows(stored: StoredRecords, count: int) -> Iterator[StoredRow]:
    """At most `count` of all stored instances and one more per trajectory, evenly spread."""
    step = max(1, -(-sum(map(len, stored.values())) // count))
    for name in sorted(stored):
        for row in range(0, len(stored[name]), step):
            yield StoredRow(name, row, stored[name].records(row, row + 1)[0], stored[name])


def read_depth(
    scan: Scan,
    domain: Domain,
    rows: Iterable[StoredRow],
    root: Path,
    folders: Mapping[str, str] | None = None,
    orders: Collection[Order] = (),
) -> DepthFrames | None:
    """The depth of instances whose frames lie below `root`; None for a domain without depth.

    `folders` are those of trajectories whose folder has another name than the trajectory, `orders`
    those of which the poses are given, too.
    """
    raw, used = [], list[StoredRow]()
    size = 0, 0
    for each in rows:
        name = (folders or {}).get(each.trajectory, each.trajectory)
        folder = f"{layout.FRAMES}/{domain.domain}/{name}/depth"
        if safe_files.kind(root, folder) is None:
            continue
        image = stored_array.open_read(root / folder, root).rows(each.row, each.row + 1)[0]
        size = image.shape
        raw.append(image[sampled_grid(size)])
        used.append(each)
    if not raw:
        return None
    known: dict[tuple[str, int], Pose] = {}

    def pose(each: StoredRow, order: Order) -> Pose:
        row = order.row(each.row, len(each.stored))
        if (each.trajectory, row) not in known:
            known[each.trajectory, row] = each.at(row).pose_in(domain.domain)
        return known[each.trajectory, row]

    def poses(order: Order) -> Floats:
        return np.array([pose(each, order) for each in used])

    in_orders = {order: poses(order) for order in orders}
    return DepthFrames(domain, np.stack(raw), size, poses(DECLARED_ORDER), scan.y_down, in_orders)


class DepthPoints:
    """Samples of depth images whose points lie between `HEIGHTS` above the floor."""

    def __init__(self, source: DepthFrames, step: int = 1) -> None:
        """Points of every `step`-th sample in each axis."""
        domain, raw = source.domain, source.raw[:, ::step, ::step]
        rows, cols = (part.ravel()[::step] + np.float64(0.5) for part in sampled_grid(source.size))
        self.source = source
        self._rays = camera.rays(domain.depth, rows, cols)
        self._metres = raw * np.float64(domain.depth_scale)
        height = domain.camera_height + self._metres * self._rays.up
        self._used = (raw >= domain.depth_raw_min) & (raw <= domain.depth_raw_max)
        self._used &= (height >= HEIGHTS[0]) & (height <= HEIGHTS[1])
        self.frames = np.nonzero(self._used)[0]

    def __len__(self) -> int:
        return len(self.frames)

    def on_floor(
        self, poses: Floats | None = None, flipped: bool = False, scale: float = 1.0
    ) -> tuple[Floats, Floats]:
        """x and y of the points, (m,) each, metres.

        Other conventions than the declared ones: `poses` (n, 3), left and right exchanged if
        `flipped`, depth multiplied by `scale`. The samples stay the same.
        """
        poses = self.source.poses if poses is None else poses
        y_down = self.source.y_down != flipped
        metres = self._metres if scale == 1.0 else self._metres * scale
        x, y, _ = camera.to_floor(self._rays, metres, self.source.domain, poses, y_down)
        return x[self._used], y[self._used]


def pixels_on_map(
    x: Floats, y: Floats, bounds: Bounds, y_down: bool, size: tuple[int, int]
) -> NDArray[np.int64]:
    """How many points fall on each pixel of an image of (height, width) that fills the bounds.

    Its first row is the one of y0 if y grows downwards, else that of y1.
    """
    height, width = size
    column = np.floor((x - bounds.x0) * (width / bounds.width)).astype(np.int64)
    away = y - bounds.y0 if y_down else bounds.y1 - y
    row = np.floor(away * (height / bounds.height)).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = row[inside] * width + column[inside]
    return np.bincount(flat, minlength=height * width).reshape(size)
