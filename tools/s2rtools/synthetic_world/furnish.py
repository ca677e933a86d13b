"""Putting furniture into a building, and deciding what the real side does to some of it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from s2rtools.synthetic_world.floor_plan import (
    DOOR_WIDTH,
    HALF_WALL,
    SIZE,
    TURN,
    WALLS,
    WINDOW_WIDTH,
    BuildingPlan,
    Door,
    PlanRoom,
    Wall,
    leaf,
    openings,
    walls,
)
from s2rtools.synthetic_world.furniture import PIECES, Parts, Piece, table
from s2rtools.synthetic_world.routes import BODY, CELL, CLEARANCE, clearance
from s2rtools.synthetic_world.scene import SceneObject, ScenePart, footprint

LISTS: dict[str, tuple[str, ...]] = {
    "office": ("desk", "desk", "shelf", "cabinet", "whiteboard", "plant", "poster", "bin",
               "clothes", "shelf", "poster"),
    "studio": ("desk", "desk", "desk", "desk", "plant", "cabinet", "poster", "poster", "shelf",
               "lockers", "bin"),
    "meeting": ("whiteboard", "cabinet", "plant", "poster", "whiteboard", "plant", "clothes",
                "poster", "shelf"),
    "kitchen": ("kitchen", "fridge", "bin", "cabinet", "poster", "plant", "bin", "clothes",
                "poster"),
    "lounge": ("sofa", "sofa", "shelf", "plant", "plant", "poster", "poster", "cabinet", "bin"),
    "library": ("shelf", "shelf", "shelf", "shelf", "shelf", "shelf", "sofa", "desk", "plant",
                "poster", "poster"),
    "laboratory": ("desk", "desk", "rack", "cabinet", "cabinet", "whiteboard", "lockers",
                   "poster", "bin", "shelf"),
    "servers": ("rack", "rack", "rack", "rack", "rack", "desk", "cabinet", "cartons", "poster",
                "extinguisher"),
    "copy": ("printer", "printer", "shelf", "shelf", "cabinet", "cartons", "bin", "poster",
             "plant", "poster"),
    "workshop": ("desk", "desk", "lockers", "cabinet", "rack", "cartons", "shelf", "poster",
                 "whiteboard", "bin"),
    "reception": ("sofa", "desk", "plant", "plant", "poster", "cabinet", "clothes", "shelf",
                  "poster", "bin"),
    "archive": ("lockers", "lockers", "shelf", "shelf", "cartons", "shelf", "cabinet", "poster",
                "lockers", "poster"),
    "corridor": ("poster", "plant", "extinguisher", "poster", "lockers", "poster", "cabinet",
                 "poster", "shelf", "poster", "bin", "poster"),
}  # fmt: skip
"""What a room of each kind would like to hold, the most wanted first."""

_BULKY = ("desk", "table", "sofa", "cabinet", "cartons", "rack", "printer", "plant", "lockers")
_NO_TABLE = ("corridor", "servers", "copy", "archive")
_GAP = 0.06
_TRIES = 60


@dataclass(frozen=True, slots=True)
class Spot:
    """A place at a wall: `at` metres along it, `width` of it, `depth` into the room."""

    room: str
    wall: Wall
    at: float
    width: float
    depth: float
    hangs: bool


@dataclass(slots=True)
class Furnishing:
    """Things in the order of their ids, and the places that are taken."""

    plan: BuildingPlan
    rng: np.random.Generator
    things: list[SceneObject] = field(default_factory=list)
    spots: list[Spot] = field(default_factory=list)

    def add(self, name: str, room: PlanRoom) -> bool:
        """Put a piece somewhere at the walls of a room; whether there was a place for it."""
        spot = self.find(PIECES[name], room)
        if spot is None:
            return False
        parts = standing(PIECES[name].make(self.rng), room, spot)
        self.things.append(SceneObject(name, parts, parts))
        self.spots.append(spot)
        return True

    def find(self, piece: Piece, room: PlanRoom) -> Spot | None:
        sides = [wall for wall in WALLS if wall not in room.open_walls]
        for _ in range(_TRIES if sides else 0):
            wall = sides[int(self.rng.integers(len(sides)))]
            length = room.area.length(wall)
            reach = piece.width / 2 + HALF_WALL + 0.03
            if length <= 2 * reach:
                continue
            at = float(self.rng.uniform(reach, length - reach))
            if room.is_corridor and piece.depth > 0.8:
                return None
            spot = Spot(room.name, wall, at, piece.width, piece.depth, piece.hangs)
            if self._fits(room, spot):
                return spot
        return None

    def _fits(self, room: PlanRoom, spot: Spot) -> bool:
        for at, _ in openings(self.plan, room, spot.wall):
            free = DOOR_WIDTH / 2 + 0.12
            swing = 1.15 if not room.is_corridor else 0.0
            if (
                spot.at + spot.width / 2 > at - free - swing
                and spot.at - spot.width / 2 < at + free
            ):
                return False
        for wall, at in room.windows:
            near = abs(spot.at - at) < (spot.width + WINDOW_WIDTH) / 2 + 0.05
            if wall == spot.wall and near and (spot.hangs or spot.depth < 0.5):
                return False
        return not any(
            _overlap(self._box(room, spot), self._box(room, other))
            for other in self.spots
            if other.room == room.name and not self._passes(spot, other)
        ) and not any(_overlap(self._box(room, spot), doorway) for doorway in self._doorways(room))

    @staticmethod
    def _passes(spot: Spot, other: Spot) -> bool:
        """A thing that hangs and a low thing may share a stretch of wall."""
        return spot.hangs != other.hangs and min(spot.depth, other.depth) < 0.07 and max(
            spot.depth, other.depth) > 0.6  # fmt: skip

    def _box(self, room: PlanRoom, spot: Spot) -> tuple[float, float, float, float]:
        x, y = room.area.on_wall(spot.wall, spot.at, spot.depth / 2 + HALF_WALL)
        half = spot.width / 2 + _GAP, spot.depth / 2 + _GAP
        if spot.wall in ("west", "east"):
            half = half[1], half[0]
        return x - half[0], y - half[1], x + half[0], y + half[1]

    def _doorways(self, room: PlanRoom) -> Iterable[tuple[float, float, float, float]]:
        for door in self.plan.doors_of(room.name):
            side, deep = DOOR_WIDTH / 2 + 0.1, 0.9
            half = (side, deep) if door.flat else (deep, side)
            yield door.x - half[0], door.y - half[1], door.x + half[0], door.y + half[1]


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def standing(made: Parts, room: PlanRoom, spot: Spot) -> Parts:
    """A piece's parts in map coordinates."""
    x, y = room.area.on_wall(spot.wall, spot.at, HALF_WALL)
    return tuple(part.placed(x, y, TURN[spot.wall]) for part in made)


CHANGES: tuple[tuple[str, str], ...] = (
    ("bicycle", "removed"),
    ("cartons", "added"),
    ("extinguisher", "removed"),
    ("cabinet", "moved"),
    ("poster", "removed"),
    ("door", "closed"),
    ("sofa", "moved"),
    ("cartons", "added"),
    ("plant", "moved"),
    ("extinguisher", "removed"),
    ("bicycle", "removed"),
    ("poster", "removed"),
    ("door", "closed"),
    ("cabinet", "moved"),
    ("cartons", "added"),
    ("lockers", "removed"),
)
"""What the real side does at severity 1; at less, the first of them."""

_IN_ROOMS = ("sofa", "cabinet", "cartons")


def furnish(
    plan: BuildingPlan, visited: list[str], closable: list[Door], seed: int
) -> list[SceneObject]:
    """Everything that stands in a building, as it stands on either side; doors come last.

    What changes goes first, to where the routes pass: `visited` are names of rooms, `closable`
    doors that no route needs. Ids are places in the list, from 1.
    """
    done = Furnishing(plan, np.random.default_rng([seed, 2]))
    corridors = [plan.room(name) for name in visited if plan.room(name).is_corridor]
    chambers = [plan.room(name) for name in visited if not plan.room(name).is_corridor]
    turns: Counter[str] = Counter()
    shut: set[Door] = set()
    for name, kind in CHANGES:
        turn = turns[name]
        turns[name] += 1
        if name == "door":
            shut.update(door for door in closable[turn : turn + 1])
            continue
        near, far = (chambers, corridors) if name in _IN_ROOMS else (corridors, chambers)
        shift = (turn + len(name)) % len(near)
        _place_change(done, name, kind, [*near[shift:], *near[:shift], *far])
    for room in plan.rooms:
        first = len(done.things)
        repeat = 2 if room.area.length("north") * room.area.length("west") > 30 else 1
        for name in LISTS[room.kind] * repeat:
            done.add(name, room)
        _centre_tables(done, room)
        _clear_ways(done, room, first)
    for door in plan.doors:
        is_open = (leaf(plan, door, True),)
        if door in shut:
            done.things.append(SceneObject("door", is_open, (leaf(plan, door, False),), "closed"))
        else:
            done.things.append(SceneObject("door", is_open, is_open))
    return done.things


def _place_change(done: Furnishing, name: str, kind: str, rooms: list[PlanRoom]) -> None:
    """Put a thing that changes into the first of the rooms that has a place for it."""
    for room in rooms:
        spot = done.find(PIECES[name], room)
        if spot is None:
            continue
        done.spots.append(spot)
        parts = PIECES[name].make(done.rng)
        here = standing(parts, room, spot)
        if kind == "moved":
            other = done.find(PIECES[name], room)
            if other is None:
                continue
            done.spots.append(other)
            done.things.append(SceneObject(name, here, standing(parts, room, other), kind))
        else:
            sim, real = (here, ()) if kind == "removed" else ((), here)
            done.things.append(SceneObject(name, sim, real, kind))
        return


def _centre_tables(done: Furnishing, room: PlanRoom) -> None:
    """Tables in the middle of rooms that are wide enough to walk around them."""
    wide, deep = room.area.length("north"), room.area.length("west")
    if room.kind in _NO_TABLE or min(wide, deep) < 4.0:
        return
    x, y = room.area.centre
    spread = [-2.0, 2.0] if max(wide, deep) > 7.0 else [0.0]
    for step in spread:
        at = (x, y + step) if deep > wide else (x + step, y)
        turn = (math.pi / 2 if deep > wide else 0.0) + float(done.rng.uniform(-0.1, 0.1))
        parts = tuple(part.placed(*at, turn) for part in table(done.rng))
        done.things.append(SceneObject("table", parts, parts))


def _clear_ways(done: Furnishing, room: PlanRoom, first: int) -> None:
    """Take the youngest bulky things out again until doors and both halves of a room connect."""
    building = [part for part in walls(done.plan) if part.low < BODY]
    while not _connected(done, room, building):
        bulky = [k for k in range(first, len(done.things)) if done.things[k].name in _BULKY]
        if not bulky:
            return
        del done.things[bulky[-1]]


def _connected(done: Furnishing, room: PlanRoom, building: list[ScenePart]) -> bool:
    area, cells = room.area, round(SIZE / CELL)
    parts = [p for thing in done.things for p in (*thing.sim, *thing.real) if p.low < BODY]
    free = clearance(footprint([*building, *parts], cells, CELL, 0.05)) >= CLEARANCE
    rows = slice(round(area.y0 / CELL), round(area.y1 / CELL))
    cols = slice(round(area.x0 / CELL), round(area.x1 / CELL))
    labels, _ = ndimage.label(free[rows, cols], structure=np.ones((3, 3)))
    wanted = [labels[half] for half in _halves(labels.shape)]
    for door in done.plan.doors_of(room.name):
        i, j = (int(v / CELL) - s.start for v, s in ((door.y, rows), (door.x, cols)))
        wanted.append(labels[max(i - 4, 0) : i + 5, max(j - 4, 0) : j + 5])
    common = set(np.unique(wanted[0])) - {0}
    for part in wanted[1:]:
        common &= set(np.unique(part))
    return bool(common)


def _halves(shape: tuple[int, int]) -> list[tuple[slice, slice]]:
    """The outer thirds of a grid along its longer side."""
    rows, cols = shape
    if rows >= cols:
        return [(slice(0, rows // 3), slice(None)), (slice(-(rows // 3), None), slice(None))]
    return [(slice(None), slice(0, cols // 3)), (slice(None), slice(-(cols // 3), None))]
