"""Points in a plane: columns of coordinates, and the nearest point."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.drawing.plot import Phrase
from s2rtui.drawing.scale import Floats


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
