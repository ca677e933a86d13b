"""Candidate poses: free places of the building times headings, and how similar poses are."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.rooms import room_codes
from s2rstore.reader import Store
from s2rstore.records import Room
from s2rtools.datasets.floor.free_floor import FreeFloor, turns
from s2rtools.synthetic_world.world import World

if TYPE_CHECKING:
    from s2rtools.common.command_line.progress import Reporter


Poses = NDArray[np.float64]
"""(n, 3): x, y in metres, heading in radians."""
Floats = NDArray[np.float64]
Codes = NDArray[np.int32]

CUTOFF = 3.0
"""Distance, in units of `reach`, beyond which the similarity is 0."""
SPACING = 0.5
"""Metres between neighbouring places."""
HEADINGS = 8
MAX_PLACES = 3000
"""Above this number of places their spacing grows."""
_GROWTH = 1.25
_PLACES_AT_ONCE = 256
"""Places between two reports of progress."""


@dataclass(frozen=True, slots=True)
class PoseSimilarity:
    """Product of three factors in [0, 1]; equal poses have similarity 1.

    A Gaussian of the distance with standard deviation `reach` (metres), exp((cos a - 1) / w^2) of
    the angle a between the headings with w = `width` (radians), which is nearly a Gaussian of that
    deviation, and `through_walls` for poses in different rooms.
    """

    reach: float = 1.5
    width: float = 0.8
    through_walls: float = 0.25

    def of_places(
        self, first: Floats, first_rooms: Codes, second: Floats, second_rooms: Codes
    ) -> Floats:
        """Similarity (n, m) of positions (n, 2) and (m, 2) with rooms (n,) and (m,)."""
        square = (
            np.square(first[:, 0][:, None] - second[:, 0])
            + np.square(first[:, 1][:, None] - second[:, 1])
        ) / self.reach**2  # fmt: skip
        near = np.where(square <= CUTOFF**2, np.exp(-square / 2), 0.0)
        same_room = first_rooms[:, None] == second_rooms
        return np.where(same_room, near, self.through_walls * near)

    def of_headings(self, first: Floats, second: Floats) -> Floats:
        """Similarity (n, m) of headings (n,) and (m,), radians."""
        return np.exp((np.cos(first[:, None] - second) - 1) / self.width**2)

    def of_poses(
        self, first: Poses, first_rooms: Codes, second: Poses, second_rooms: Codes
    ) -> Floats:
        """Similarity (n, m) of poses (n, 3) and (m, 3) with rooms (n,) and (m,)."""
        places = self.of_places(first[:, :2], first_rooms, second[:, :2], second_rooms)
        return places * self.of_headings(first[:, 2], second[:, 2])


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

    def without(self, cells: NDArray[np.intp]) -> CandidatePoses:
        """The same candidates, of which flat indices (n,) are not usable."""
        usable = self.usable.copy()
        usable.flat[cells] = False
        return replace(self, usable=usable)

    def poses(self, cells: NDArray[np.intp]) -> Poses:
        """The poses (n, 3) of flat indices (n,) into (P, H)."""
        place, heading = np.divmod(cells, self.headings.size)
        return np.column_stack([self.places[place], self.headings[heading]])

    def rooms_of(self, cells: NDArray[np.intp]) -> Codes:
        """The rooms (n,) of flat indices (n,) into (P, H)."""
        return self.rooms[cells // self.headings.size]


def find_candidates(store: Store, reporter: Reporter | None = None) -> CandidatePoses:
    """The poses at which a robot could take an image.

    Of a synthetic world they are its free floor without views of a near wall; else places
    near recorded poses of any trajectory. Raises RequestError where the store has no poses.
    """
    floor = FreeFloor.of_store(store, "collect")
    names = store.instances.room_names
    if floor.world is None:
        places = _places(floor)
        usable = np.ones((len(places), HEADINGS), dtype=np.bool_)
        candidates = _candidates(places, usable, store.rooms, names, floor.origin)
    else:
        candidates = world_candidates(floor.world, store.rooms, names, reporter)
    if not candidates.count:
        raise RequestError(f"{store.path}: no free place was found; ingest more poses")
    return candidates


def world_candidates(
    world: World,
    rooms: Sequence[Room],
    names: Sequence[str],
    reporter: Reporter | None = None,
) -> CandidatePoses:
    """The free floor of a synthetic world, without views of a near wall.

    Rooms are codes into `names`.
    """
    if reporter is not None:
        reporter.say("looking for free places; the first call compiles the ray caster (a minute)")
    floor = FreeFloor.of_world(world)
    places = _places(floor)
    usable = _with_content(world, places, turns(HEADINGS), reporter)
    return _candidates(places, usable, rooms, names, floor.origin)


def _candidates(
    places: Floats,
    usable: NDArray[np.bool_],
    rooms: Sequence[Room],
    names: Sequence[str],
    origin: str,
) -> CandidatePoses:
    codes = room_codes(places[:, 0], places[:, 1], rooms, names)
    return CandidatePoses(places, turns(usable.shape[1]), usable, codes, origin)


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
