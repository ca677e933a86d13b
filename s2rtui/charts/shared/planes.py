"""Planes of positions: layers that all maps share, points of instances, the nearest point."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import LEVEL_TEXT
from s2rstore.reader import Store
from s2rstore.records import Bounds, Room
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.charts.scene import Scene
from s2rtui.drawing.plane_marks import Columns, Floor, Outlines, Place, ScaleBar, Unselected
from s2rtui.drawing.plot import Mark, Phrase, Plot
from s2rtui.drawing.scale import Floats, Range, Scale, percentile_range

PANEL = "map"


def map_plot(
    marks: Iterable[Mark], area: Bounds, y_down: bool, name: str = PANEL,
    title: tuple[Phrase, ...] = (), weight: float = 0.0,
) -> Plot:  # fmt: skip
    """A plot of an area in metres with equal scales."""
    ends = (area.y1, area.y0) if y_down else (area.y0, area.y1)
    x, y = Scale(area.x0, area.x1, ("x (m)", "x m")), Scale(*ends, ("y (m)", "y m"))
    return Plot(x, y, tuple(marks), name, title, weight, "plane", True, True)


def ground_marks(
    floor: Floor, rooms: tuple[Room, ...], truth: Columns, selected: Bools, valid: Bools
) -> tuple[Mark, ...]:
    """The marks below the selected instances."""
    return floor, Outlines(rooms), ScaleBar(), Unselected(*truth, selected, valid)


def shown_rooms(scene: Scene) -> tuple[Room, ...]:
    """The rooms whose outlines and names are shown."""
    return scene.store.rooms if scene.state.room_names else ()


def true_columns(store: Store, domain: str | None = None) -> Columns:
    """True positions x and y (N,) of the instances, or of the images of a domain, metres."""
    if domain is not None and domain in store.domains_with_own_poses:
        return _columns(store.poses(domain))
    return store.instances.x, store.instances.y


@cached_by_identity(4)
def _columns(poses: NDArray[np.float64]) -> Columns:
    return poses[:, 0].copy(), poses[:, 1].copy()


def place_of(points: Columns, headings: Floats | None, iid: int | None) -> tuple[Place, ...]:
    """The pose of an instance; empty where there is none, or its position is unknown."""
    if iid is None:
        return ()
    x, y = (float(part[iid]) for part in points)
    heading = np.nan if headings is None else float(headings[iid])
    if not np.isfinite([x, y]).all():
        return ()
    return ((x, y, heading if np.isfinite(heading) else None),)


def shown_area(viewport: Bounds | None, bounds: Bounds, truth: Columns, valid: Bools) -> Bounds:
    """The viewport, or the bounds, or the bounding box of the points where these are empty."""
    if viewport is not None:
        return viewport
    if bounds.width > 0 and bounds.height > 0:
        return bounds
    points = np.stack([part[valid] for part in truth], axis=1)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return Bounds(0.0, 0.0, 1.0, 1.0)
    (x0, y0), (x1, y1) = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    return Bounds(float(x0), float(y0), float(x1), float(y1))


@cached_by_identity(16)
def value_range(values: Floats, valid: Bools) -> Range:
    """The scale of values (N,): 1st to 99th percentile of the valid ones."""
    return percentile_range(values[valid])


def true_positions(store: Store) -> NDArray[np.float64]:
    """(N, 2) true positions, metres."""
    return stacked_points(store.instances.x, store.instances.y)


@cached_by_identity(24)
def stacked_points(x: Floats, y: Floats) -> NDArray[np.float64]:
    """Stack two columns to (N, 2); the same columns give the same array, so caches keep working."""
    return np.stack([x, y], axis=1).astype(np.float64, copy=False)


def valid_cursor(cursor: int | None, valid: NDArray[np.bool_]) -> int | None:
    """The cursor if it is a valid iid, else None."""
    is_valid = cursor is not None and 0 <= cursor < len(valid) and valid[cursor]
    return cursor if is_valid else None


SIDE_PHRASES = (
    Phrase("sim", "sim", "sim"), Phrase("real", "real", "real"),
    Phrase(f"{LEVEL_TEXT} interval", sign="interval"),
)  # fmt: skip
"""What the signs of the sides and the line of an interval mean, for the legend of a table."""


def cursor_phrases(cursor: int | None) -> tuple[Phrase, ...]:
    """What the sign of the cursor's instance means, for a legend; nothing without one."""
    return () if cursor is None else (Phrase(f"instance {cursor}", "cursor", "cursor"),)


def known_point(points: NDArray[np.floating[Any]], iid: int | None) -> tuple[float, float] | None:
    """One of the points (N, 2), or None where it is unknown."""
    if iid is None or not np.isfinite(points[iid]).all():
        return None
    return float(points[iid, 0]), float(points[iid, 1])


def nearest_iid(
    points: NDArray[np.floating[Any]], base: NDArray[np.bool_], at: tuple[float, float]
) -> int | None:
    """The iid of the base population whose point (N, 2) is nearest to a place."""
    with np.errstate(invalid="ignore"):
        distance = np.square(points[:, 0] - at[0]) + np.square(points[:, 1] - at[1])
    distance = np.where(base & np.isfinite(distance), distance, np.inf)
    iid = int(np.argmin(distance)) if distance.size else 0
    return iid if distance.size and np.isfinite(distance[iid]) else None
