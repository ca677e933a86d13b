"""Floor plans: an image with known points, a ROS occupancy grid, or drawn from depth images.

A plan is a table of the data set configuration:

    floor_plan = "map.png"            fills the bounds
    floor_plan = "map.yaml"           a ROS occupancy grid (map_server): its image and its place
    [floor_plan]                      an image in which points are known
    image = "map.png"
    points = [[u, v, x, y], ...]      two or more: pixels from the top left corner, metres

Placed plans are resampled to the bounds of the data set, which they define if the configuration has
none. Pixels are squares; with more than two points the best fit counts. Without a plan, one is
drawn from depth images when they are stored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.image_header import read_header
from s2rstore.files.input_files import read_bytes
from s2rstore.records import Bounds
from s2rtools.common.image_files import MAX_PIXELS, whole_image
from s2rtools.common.typed_documents import convert
from s2rtools.common.yaml_files import read_yaml
from s2rtools.datasets.conventions.depth_frames import (
    DepthPoints,
    pixels_on_map,
    read_depth,
    spread_rows,
)
from s2rtools.datasets.scan import Scan, StoredRecords
from s2rtools.motion_logs.motion_log import fit_transform

Floats = NDArray[np.float64]
Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]

OUTSIDE = (205, 205, 205)
"""Colour of what a plan does not show, RGB: that of unknown cells of an occupancy grid."""
_OCCUPIED, _FREE = 40, 254
"""Grey values of occupied and free cells."""
_LONGER_SIDE = 1056
"""Pixels of a resampled plan."""
_DRAWN_FRAMES, _DRAWN_TOGETHER = 400, 25
_DRAWN_CELL = 0.05
"""Metres of a pixel of a plan that is drawn from depth, or more if it would be too large."""
_MAX_BYTES = 256 << 20
_MAX_ASPECT_RATIO = 50
"""Longer side over shorter side."""
_MAX_RESIDUAL = 0.02
"""Distance of known points from their fit, as a share of their extent, that is refused."""

Resolve = Callable[[str], Path]
"""The path of a file that a configuration names. Raises RequestError for one outside its folder."""


class PointsTable(Struct, forbid_unknown_fields=True):
    """An image with known points (u, v, x, y): pixels and metres."""

    image: str
    points: list[tuple[Coordinate, Coordinate, Coordinate, Coordinate]]

    def __post_init__(self) -> None:
        if not self.image or not self.image.isprintable():
            raise ValueError("image must be the name of a file")
        if len(self.points) < 2:
            raise ValueError("points needs two points [u, v, x, y] or more")


class GridTable(Struct):
    """The keys of a ROS `map.yaml`; further ones have no meaning here."""

    image: str
    resolution: Annotated[float, Meta(gt=0, le=1e3)]
    origin: tuple[Coordinate, Coordinate, Annotated[float, Meta(ge=-10, le=10)]]
    negate: bool | int = False
    occupied_thresh: Annotated[float, Meta(ge=0, le=1)] = 0.65
    free_thresh: Annotated[float, Meta(ge=0, le=1)] = 0.196
    mode: str = "trinary"

    def __post_init__(self) -> None:
        if self.mode not in ("trinary", "scale"):
            raise ValueError("mode is trinary or scale")


@dataclass(frozen=True, slots=True, eq=False)
class PlacedPlan:
    """An image (h, w, 3) uint8 RGB and where it lies.

    `to_map` (2, 3) maps continuous pixel coordinates (u, v, 1) to x, y in metres.
    """

    image: NDArray[np.uint8]
    to_map: Floats

    @property
    def bounds(self) -> Bounds:
        """The smallest rectangle that holds the whole image."""
        height, width = self.image.shape[:2]
        corners = np.array([[u, v, 1.0] for u in (0, width) for v in (0, height)])
        low, high = (self.to_map @ corners.T).min(axis=1), (self.to_map @ corners.T).max(axis=1)
        return Bounds(float(low[0]), float(low[1]), float(high[0]), float(high[1]))

    def resampled(self, bounds: Bounds, y_down: bool) -> NDArray[np.uint8]:
        """The plan as an image (h, w, 3) RGB that fills the bounds; its first row is the top one.

        The top is y0 if y grows downwards, else y1. What the plan does not show is `OUTSIDE`.
        """
        metres = max(bounds.width, bounds.height) / _LONGER_SIDE
        size = max(1, round(bounds.width / metres)), max(1, round(bounds.height / metres))
        step_x, step_y = bounds.width / size[0], bounds.height / size[1]
        top, step_y = (bounds.y0, step_y) if y_down else (bounds.y1, -step_y)
        to_map = np.array([[step_x, 0, bounds.x0], [0, step_y, top], [0, 0, 1]])
        to_image = np.linalg.inv(np.vstack([self.to_map, [0, 0, 1]])) @ to_map
        half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # OpenCV counts from pixel centres
        matrix = np.linalg.inv(half) @ to_image @ half
        shrinks = abs(float(np.linalg.det(to_image[:2, :2]))) ** 0.5
        image, scale = self.image, max(1, math.floor(shrinks))
        if scale > 1:  # averaged first, because warping takes single pixels
            small = -(-image.shape[1] // scale), -(-image.shape[0] // scale)
            padded = cv2.copyMakeBorder(
                image, 0, small[1] * scale - image.shape[0], 0,
                small[0] * scale - image.shape[1], cv2.BORDER_REPLICATE,
            )  # fmt: skip
            image = np.asarray(cv2.resize(padded, small, interpolation=cv2.INTER_AREA), np.uint8)
            matrix = np.linalg.inv(half) @ np.diag([1 / scale, 1 / scale, 1]) @ half @ matrix
        warped = cv2.warpAffine(
            image, matrix[:2], size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT, borderValue=OUTSIDE,
        )  # fmt: skip
        return np.asarray(warped, dtype=np.uint8)


def placed_plan(
    declared: str | PointsTable, where: str, resolve: Resolve, y_down: bool
) -> PlacedPlan | None:
    """The placed plan of a configuration; None for an image that fills the bounds, or without one.

    `where` is the configuration file. Raises RequestError if the plan cannot be used.
    """
    if isinstance(declared, PointsTable):
        return plan_with_points(declared, f"{where}: floor_plan.points", resolve, y_down)
    if declared.lower().endswith((".yaml", ".yml")):
        path = resolve(declared)
        folder = Path(declared).parent
        return occupancy_grid(path, lambda name: resolve(str(folder / name)))
    return None


def plan_with_points(table: PointsTable, where: str, resolve: Resolve, y_down: bool) -> PlacedPlan:
    """Place an image by its known points. Raises RequestError, beginning with `where`."""
    image = _read_rgb(resolve(table.image))
    points = np.array(table.points)
    return PlacedPlan(image, fit_similarity(points[:, :2], points[:, 2:], y_down, where))


def fit_similarity(pixels: Floats, metres: Floats, y_down: bool, where: str) -> Floats:
    """(2, 3): the similarity that maps pixels (n, 2) to metres (n, 2) best, by least squares.

    v grows downwards, so that the map is mirrored unless y does so, too. Raises RequestError,
    beginning with `where`, if the points coincide or do not fit: their distance in metres must be
    that in pixels times one scale, and their orientation that of `y_down`.
    """
    hand = 1.0 if y_down else -1.0
    extent = float(np.hypot(*(metres - metres.mean(axis=0)).T).max())
    if np.hypot(*(pixels - pixels.mean(axis=0)).T).max() < 1.0 or extent < 0.01:
        raise RequestError(f"{where}: the points coincide; give two that are far apart")
    upright, known = (pixels[:, 0], hand * pixels[:, 1]), (metres[:, 0], metres[:, 1])
    found = fit_transform(upright, known, scale=True)
    cos, sin = found.scale * math.cos(found.angle), found.scale * math.sin(found.angle)
    matrix = np.array([[cos, -sin * hand, found.x], [sin, cos * hand, found.y]])
    moved = pixels @ matrix[:, :2].T + matrix[:, 2]
    residual = float(np.hypot(*(moved - metres).T).max())
    if residual > _MAX_RESIDUAL * extent:
        raise RequestError(
            f"{where}: the points miss their best fit by up to {residual:.2f} m; check them, and "
            "y_down"
        )
    return matrix


def occupancy_grid(path: Path, resolve: Resolve) -> PlacedPlan:
    """Read a ROS occupancy grid: free cells light, occupied ones dark, unknown ones `OUTSIDE`.

    Source of the format: the documentation of ROS `map_server`. Raises RequestError if the file
    or its image cannot be used.
    """
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise RequestError(f"{path}: expected KEY: VALUE lines, as ROS map_server writes them")
    table = convert(document, GridTable, str(path))
    grey = cv2.cvtColor(_read_rgb(resolve(table.image)), cv2.COLOR_RGB2GRAY)
    occupancy = grey / 255.0 if table.negate else 1.0 - grey / 255.0
    image = np.full(grey.shape, OUTSIDE[0], dtype=np.uint8)
    if table.mode == "scale":
        image = np.round(_FREE + (_OCCUPIED - _FREE) * occupancy).astype(np.uint8)
    image[occupancy < table.free_thresh] = _FREE
    image[occupancy > table.occupied_thresh] = _OCCUPIED
    x, y, yaw = table.origin
    cos, sin = table.resolution * math.cos(yaw), table.resolution * math.sin(yaw)
    height = grey.shape[0]
    to_map = np.array([[cos, sin, x - height * sin], [sin, -cos, y + height * cos]])
    return PlacedPlan(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB), to_map)


def read_floor_plan(path: Path) -> NDArray[Any] | None:
    """The image, (h, w, 3) uint8 BGR; None if it is not an image or is damaged.

    Raises RequestError if the file is too large or declares an implausible size.
    """
    content = read_bytes(path, _MAX_BYTES)
    try:
        header = read_header(content)
    except ValueError:
        return None
    size = f"{path}: {header.width}x{header.height} pixels"
    if header.pixels > MAX_PIXELS:
        raise RequestError(f"{size}; a floor plan has at most {MAX_PIXELS:,} in all; scale it")
    if max(header.size) > _MAX_ASPECT_RATIO * min(header.size):
        raise RequestError(
            f"{size}; the longer side of a floor plan is at most {_MAX_ASPECT_RATIO} times "
            "the shorter"
        )
    try:
        whole = np.frombuffer(whole_image(content, header), np.uint8)
        return cv2.imdecode(whole, cv2.IMREAD_COLOR)
    except (ValueError, cv2.error):
        return None


def _read_rgb(path: Path) -> NDArray[np.uint8]:
    image = read_floor_plan(path)
    if image is None:
        raise RequestError(f"{path}: not an image that can be read")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class DrawnPlan:
    """A plan (h, w, 3) uint8 BGR that was drawn from depth images of a domain."""

    image: NDArray[np.uint8]
    domain: str
    frames: int


def plan_from_depth(scan: Scan, stored: StoredRecords, root: Path) -> DrawnPlan | None:
    """A plan that fills the bounds, drawn from depth images below `root`.

    A cell is the darker, the more points between 0.1 and 2 m above the floor fall on it. The domain
    is the first simulated one with depth, whose poses are exact, else the first one. None without
    poses or depth, or where nothing lies on the map.
    """
    bounds = scan.bounds
    for domain in sorted(scan.domains.values(), key=lambda each: each.kind != "sim"):
        if not scan.has_poses:
            break
        metres = max(_DRAWN_CELL, max(bounds.width, bounds.height) / _LONGER_SIDE)
        size = max(1, round(bounds.height / metres)), max(1, round(bounds.width / metres))
        counts, used = np.zeros(size, np.int64), 0
        remaining = spread_rows(stored, _DRAWN_FRAMES)
        while rows := list(islice(remaining, _DRAWN_TOGETHER)):
            if (frames := read_depth(scan, domain, rows, root)) is not None:
                x, y = DepthPoints(frames).on_floor()
                counts += pixels_on_map(x, y, bounds, scan.y_down, size)
                used += len(frames.poses)
        if counts.any():
            return DrawnPlan(_shaded(counts), domain.domain, used)
    return None


def _shaded(counts: NDArray[np.int64]) -> NDArray[np.uint8]:
    """An image (h, w, 3), the same in RGB and BGR, of counts (h, w) that are not all 0."""
    dark = np.minimum(1.0, counts / np.percentile(counts[counts > 0], 90))
    grey = np.round(_FREE + (_OCCUPIED - _FREE) * np.sqrt(dark)).astype(np.uint8)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB), dtype=np.uint8)
