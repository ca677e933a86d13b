"""Candidate poses: free places of the building times headings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from s2rstore.errors import RequestError
from s2rstore.geometry.rooms import room_codes
from s2rstore.reader import Store
from s2rstore.records import Room
from s2rtools.data_collection.pose_similarity import Codes, Floats, Poses
from s2rtools.synthetic_world.dataset import WorldData
from s2rtools.synthetic_world.routes import CLEARANCE, FLOOR_CELL
from s2rtools.synthetic_world.world import World

if TYPE_CHECKING:
    from s2rtools.common.command_line.progress import Reporter

SPACING = 0.5
"""Metres between neighbouring places."""
HEADINGS = 8
MAX_PLACES = 3000
"""Above this number of places their spacing grows."""
REACH = 0.6
"""Metres from a recorded pose within which the floor counts as free."""
_GROWTH = 1.25
_PLACES_AT_ONCE = 256
"""Places between two reports of progress."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePoses:
    """Places (P, 2) in metres, headings (H,) in radians, and which pairs of both are usable.

    `usable` (P, H); `rooms` (P,) are codes into the names of the store's rooms, -1 for none.
    `origin` says how the places were found, in one phrase.
    """

    places: Floats
    headings: Floats
    usable: NDArray[np.bool_]
    rooms: Codes
    origin: str

    @property
    def count(self) -> int:
        """The number of usable poses."""
        return int(np.count_nonzero(self.usable))

    def poses(self, cells: NDArray[np.intp]) -> Poses:
        """The poses (n, 3) of flat indices (n,) into (P, H)."""
        place, heading = np.divmod(cells, self.headings.size)
        return np.column_stack([self.places[place], self.headings[heading]])

    def rooms_of(self, cells: NDArray[np.intp]) -> Codes:
        """The rooms (n,) of flat indices (n,) into (P, H)."""
        return self.rooms[cells // self.headings.size]


def find_candidates(
    store: Store, headings: int = HEADINGS, reporter: Reporter | None = None
) -> CandidatePoses:
    """The poses at which a robot could take an image.

    Of a synthetic world they are its free floor without views of a near wall; else places
    near recorded poses of any trajectory. Raises RequestError where the store has no poses.
    """
    store.require_poses("collect")
    data = WorldData.of_store(store)
    truth = store.instances
    recorded = np.column_stack([truth.x, truth.y])
    recorded = recorded[np.isfinite(recorded).all(axis=1)]
    if not len(recorded):
        raise RequestError(f"{store.path}: no instance has a position; collect needs them")
    names = truth.room_names
    if data is None:
        places = _places(recorded, lambda points, spacing: _is_near(points, spacing, recorded))
        usable = np.ones((len(places), headings), dtype=np.bool_)
        origin = f"places within {REACH:g} m of recorded poses"
        candidates = _candidates(places, usable, store.rooms, names, origin)
    else:
        candidates = world_candidates(data.world, store.rooms, names, headings, reporter)
    if not candidates.count:
        raise RequestError(f"{store.path}: no free place was found; ingest more poses")
    return candidates


def world_candidates(
    world: World,
    rooms: Sequence[Room],
    names: Sequence[str],
    headings: int = HEADINGS,
    reporter: Reporter | None = None,
) -> CandidatePoses:
    """The free floor of a synthetic world, without views of a near wall.

    Rooms are codes into `names`.
    """
    if reporter is not None:
        reporter.say("looking for free places; the first call compiles the ray caster (a minute)")
    extent = np.array([[0.0, 0.0], [1.0, 1.0]]) * len(world.floor.clearance) * FLOOR_CELL
    places = _places(extent, lambda points, spacing: is_free(world, points))
    usable = _with_content(world, places, _turns(headings), reporter)
    return _candidates(places, usable, rooms, names, "free floor of the synthetic world")


def _turns(headings: int) -> Floats:
    return np.linspace(-math.pi, math.pi, headings, endpoint=False)


def _candidates(
    places: Floats,
    usable: NDArray[np.bool_],
    rooms: Sequence[Room],
    names: Sequence[str],
    origin: str,
) -> CandidatePoses:
    codes = room_codes(places[:, 0], places[:, 1], rooms, names)
    return CandidatePoses(places, _turns(usable.shape[1]), usable, codes, origin)


def is_free(world: World, points: Floats) -> NDArray[np.bool_]:
    """Whether a robot has room at each position (n, 2) of a synthetic world."""
    clearance = world.floor.clearance
    column, row = np.floor(points / FLOOR_CELL).astype(np.intp).T
    inside = (row >= 0) & (column >= 0) & (row < clearance.shape[0]) & (column < clearance.shape[1])
    free = np.zeros(len(points), dtype=np.bool_)
    free[inside] = clearance[row[inside], column[inside]] >= CLEARANCE
    return free


def _is_near(points: Floats, spacing: float, recorded: Floats) -> NDArray[np.bool_]:
    reach = max(REACH, 0.75 * spacing)
    distance, _ = KDTree(recorded).query(points, distance_upper_bound=reach)
    return np.isfinite(distance)


def _places(extent: Floats, is_place: Callable[[Floats, float], NDArray[np.bool_]]) -> Floats:
    """Cell centres of a square grid over the extent of points (n, 2) that are places."""
    spacing = SPACING
    while True:
        low = np.floor((extent.min(axis=0) - REACH) / spacing) * spacing
        sizes = np.ceil((extent.max(axis=0) + REACH - low) / spacing).astype(np.intp)
        if np.prod(sizes.astype(np.float64)) <= 100 * MAX_PLACES:
            x, y = (low[k] + (np.arange(sizes[k]) + 0.5) * spacing for k in (0, 1))
            points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
            points = points[is_place(points, spacing)]
            if len(points) <= MAX_PLACES:
                return points
        spacing *= _GROWTH


def _with_content(
    world: World, places: Floats, headings: Floats, reporter: Reporter | None
) -> NDArray[np.bool_]:
    """Whether each view (P, H) shows more than a near wall."""
    usable = np.zeros((len(places), headings.size), dtype=np.bool_)
    if reporter is not None:
        reporter.begin("views of free places", len(places))
    for start in range(0, len(places), _PLACES_AT_ONCE):
        some = places[start : start + _PLACES_AT_ONCE]
        poses = np.column_stack(
            [np.repeat(some, headings.size, axis=0), np.tile(headings, len(some))]
        )
        usable[start : start + len(some)] = world.has_content(poses).reshape(len(some), -1)
        if reporter is not None:
            reporter.advance(len(some))
    return usable
