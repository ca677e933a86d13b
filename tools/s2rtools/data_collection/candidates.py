"""Candidate poses: free places of the building times headings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
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


@dataclass(frozen=True, slots=True)
class FreeFloor:
    """Where a robot can be: `is_free(points (n, 2), reach)` within `extent`, (2, 2) low and high.

    `reach` in metres matters where free floor is known by recorded poses only: it is the distance
    within which one counts. `world` is the synthetic world of the store, if it was made of one.
    `origin` says how free floor is known, in one phrase.
    """

    extent: Floats
    is_free: Callable[[Floats, float], NDArray[np.bool_]]
    world: World | None
    origin: str

    @classmethod
    def of_store(cls, store: Store, command: str) -> FreeFloor:
        """Raises RequestError, which names `command`, where the store has no poses."""
        store.require_poses(command)
        data = WorldData.of_store(store)
        if data is not None:
            return cls.of_world(data.world)
        recorded = _recorded_places(store)
        if not len(recorded):
            raise RequestError(f"{store.path}: no instance has a position; {command} needs them")
        tree = KDTree(recorded)

        def is_free(points: Floats, reach: float) -> NDArray[np.bool_]:
            return np.isfinite(tree.query(points, distance_upper_bound=max(REACH, reach))[0])

        extent = np.array([recorded.min(axis=0) - REACH, recorded.max(axis=0) + REACH])
        return cls(extent, is_free, None, f"places within {REACH:g} m of recorded poses")

    @classmethod
    def of_world(cls, world: World) -> FreeFloor:
        """The floor of a synthetic world that is free on both sides."""
        size = len(world.floor.clearance) * FLOOR_CELL
        return cls(
            np.array([[0.0, 0.0], [size, size]]), lambda points, reach: is_free(world, points),
            world, "free floor of the synthetic world",
        )  # fmt: skip

    def grid(self, spacing: float, most: int) -> Floats:
        """Centres (P, 2) of square cells of `spacing` metres that are free.

        Raises RequestError for a grid of more than `most` cells.
        """
        low = np.floor(self.extent[0] / spacing) * spacing
        sizes = np.ceil((self.extent[1] - low) / spacing)
        if np.prod(sizes) > most:
            raise RequestError(f"a grid of {spacing:g} m has more than {most:,} cells")
        x, y = (low[k] + (np.arange(int(sizes[k])) + 0.5) * spacing for k in (0, 1))
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return points[self.is_free(points, 0.75 * spacing)]


def _recorded_places(store: Store) -> Floats:
    """Positions (n, 2) where real images were taken; without any, those of the first ingest.

    Rendered poses do not count: they say nothing about where a robot can be.
    """
    real = [name for name in store.domains if store.domain(name).kind == "real"]
    counts = np.zeros(len(store.instances), dtype=np.bool_)
    for name in real:
        counts |= store.imaged(name)
    if not counts.any():
        counts[: store.parts[0].stop] = True
    places = np.column_stack([store.instances.x, store.instances.y])[counts]
    return places[np.isfinite(places).all(axis=1)]


def find_candidates(
    store: Store, headings: int = HEADINGS, reporter: Reporter | None = None
) -> CandidatePoses:
    """The poses at which a robot could take an image.

    Of a synthetic world they are its free floor without views of a near wall; else places
    near recorded poses of any trajectory. Raises RequestError where the store has no poses.
    """
    floor = FreeFloor.of_store(store, "collect")
    names = store.instances.room_names
    if floor.world is None:
        places = _places(floor)
        usable = np.ones((len(places), headings), dtype=np.bool_)
        candidates = _candidates(places, usable, store.rooms, names, floor.origin)
    else:
        candidates = world_candidates(floor.world, store.rooms, names, headings, reporter)
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
    floor = FreeFloor.of_world(world)
    places = _places(floor)
    usable = _with_content(world, places, turns(headings), reporter)
    return _candidates(places, usable, rooms, names, floor.origin)


def turns(headings: int) -> Floats:
    """Evenly spread headings (n,), radians from -pi."""
    return np.linspace(-math.pi, math.pi, headings, endpoint=False)


def _candidates(
    places: Floats,
    usable: NDArray[np.bool_],
    rooms: Sequence[Room],
    names: Sequence[str],
    origin: str,
) -> CandidatePoses:
    codes = room_codes(places[:, 0], places[:, 1], rooms, names)
    return CandidatePoses(places, turns(usable.shape[1]), usable, codes, origin)


def is_free(world: World, points: Floats) -> NDArray[np.bool_]:
    """Whether a robot has room at each position (n, 2) of a synthetic world."""
    clearance = world.floor.clearance
    column, row = np.floor(points / FLOOR_CELL).astype(np.intp).T
    inside = (row >= 0) & (column >= 0) & (row < clearance.shape[0]) & (column < clearance.shape[1])
    free = np.zeros(len(points), dtype=np.bool_)
    free[inside] = clearance[row[inside], column[inside]] >= CLEARANCE
    return free


def _places(floor: FreeFloor) -> Floats:
    """Free places (P, 2), at most `MAX_PLACES`: their spacing grows with the floor."""
    spacing = SPACING
    while True:
        with suppress(RequestError):
            points = floor.grid(spacing, 100 * MAX_PLACES)
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
