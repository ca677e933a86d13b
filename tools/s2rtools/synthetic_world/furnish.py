"""Place furniture in a building, and choose the objects that differ on the real side."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from s2rtools.synthetic_world.floor_plan import (
    BUILDING_SIZE,
    DOOR_WIDTH,
    HALF_WALL,
    WALL_ANGLES,
    WALLS,
    WINDOW_WIDTH,
    BuildingPlan,
    Door,
    PlanRoom,
    Wall,
    door_leaf,
    door_openings,
    wall_parts,
)
from s2rtools.synthetic_world.furniture import FURNITURE, FurniturePiece, Parts, table
from s2rtools.synthetic_world.routes import CLEARANCE, FLOOR_CELL, ROBOT_HEIGHT, clearance
from s2rtools.synthetic_world.scene_geometry import SceneObject, ScenePart, footprint

ROOM_FURNITURE: dict[str, tuple[str, ...]] = {
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
"""Furniture of each kind of room, in order of priority."""

_BULKY = ("desk", "table", "sofa", "cabinet", "cartons", "rack", "printer", "plant", "lockers")
_NO_TABLE = ("corridor", "servers", "copy", "archive")
_GAP = 0.06
_MAX_ATTEMPTS = 60


@dataclass(frozen=True, slots=True)
class WallSpot:
    """A place at a wall: `at` metres along it, `width` of it, `depth` into the room."""

    room: str
    wall: Wall
    at: float
    width: float
    depth: float
    hangs: bool


@dataclass(slots=True)
class Furnishing:
    """Objects in the order of their ids, and the wall spots that are occupied."""

    plan: BuildingPlan
    rng: np.random.Generator
    objects: list[SceneObject] = field(default_factory=list)
    spots: list[WallSpot] = field(default_factory=list)

    def add(self, name: str, room: PlanRoom) -> bool:
        """Place a piece at a wall of a room; False if no spot was found."""
        spot = self.find_spot(FURNITURE[name], room)
        if spot is None:
            return False
        parts = place_at_wall(FURNITURE[name].make(self.rng), room, spot)
        self.objects.append(SceneObject(name, parts, parts))
        self.spots.append(spot)
        return True

    def find_spot(self, piece: FurniturePiece, room: PlanRoom) -> WallSpot | None:
        sides = [wall for wall in WALLS if wall not in room.open_walls]
        for _ in range(_MAX_ATTEMPTS if sides else 0):
            wall = sides[int(self.rng.integers(len(sides)))]
            length = room.area.length(wall)
            reach = piece.width / 2 + HALF_WALL + 0.03
            if length <= 2 * reach:
                continue
            at = float(self.rng.uniform(reach, length - reach))
            if room.is_corridor and piece.depth > 0.8:
                return None
            spot = WallSpot(room.name, wall, at, piece.width, piece.depth, piece.hangs)
            if self._fits(room, spot):
                return spot
        return None

    def _fits(self, room: PlanRoom, spot: WallSpot) -> bool:
        for at, _ in door_openings(self.plan, room, spot.wall):
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
    def _passes(spot: WallSpot, other: WallSpot) -> bool:
        """Whether a hanging object and a low one may share a stretch of wall."""
        return spot.hangs != other.hangs and min(spot.depth, other.depth) < 0.07 and max(
            spot.depth, other.depth) > 0.6  # fmt: skip

    def _box(self, room: PlanRoom, spot: WallSpot) -> tuple[float, float, float, float]:
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


def place_at_wall(parts: Parts, room: PlanRoom, spot: WallSpot) -> Parts:
    """A piece's parts in map coordinates."""
    x, y = room.area.on_wall(spot.wall, spot.at, HALF_WALL)
    return tuple(part.transformed(x, y, WALL_ANGLES[spot.wall]) for part in parts)


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
"""Changes of the real side at severity 1; at lower severities, the first of them."""

_IN_ROOMS = ("sofa", "cabinet", "cartons")


def furnish(
    plan: BuildingPlan, visited: list[str], closable: list[Door], seed: int
) -> list[SceneObject]:
    """All objects of a building, as they are on either side; doors come last.

    Objects that change are placed first, in rooms that the routes pass: `visited` are names of
    rooms, `closable` doors that no route needs. The id of an object is its position, from 1.
    """
    furnishing = Furnishing(plan, np.random.default_rng([seed, 2]))
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
        _place_change(furnishing, name, kind, [*near[shift:], *near[:shift], *far])
    for room in plan.rooms:
        first = len(furnishing.objects)
        repeat = 2 if room.area.length("north") * room.area.length("west") > 30 else 1
        for name in ROOM_FURNITURE[room.kind] * repeat:
            furnishing.add(name, room)
        _centre_tables(furnishing, room)
        _clear_paths(furnishing, room, first)
    for door in plan.doors:
        is_open = (door_leaf(plan, door, True),)
        item = SceneObject("door", is_open, is_open)
        if door in shut:
            item = SceneObject("door", is_open, (door_leaf(plan, door, False),), "closed")
        furnishing.objects.append(item)
    return furnishing.objects


def _place_change(furnishing: Furnishing, name: str, kind: str, rooms: list[PlanRoom]) -> None:
    """Place an object that changes in the first room with a free spot."""
    for room in rooms:
        spot = furnishing.find_spot(FURNITURE[name], room)
        if spot is None:
            continue
        furnishing.spots.append(spot)
        parts = FURNITURE[name].make(furnishing.rng)
        here = place_at_wall(parts, room, spot)
        sim, real = ((), here) if kind == "added" else (here, ())
        if kind == "moved":
            other = furnishing.find_spot(FURNITURE[name], room)
            if other is None:
                continue
            furnishing.spots.append(other)
            real = place_at_wall(parts, room, other)
        furnishing.objects.append(SceneObject(name, sim, real, kind))
        return


def _centre_tables(furnishing: Furnishing, room: PlanRoom) -> None:
    """Place tables in the middle of rooms that leave space around them."""
    wide, deep = room.area.length("north"), room.area.length("west")
    if room.kind in _NO_TABLE or min(wide, deep) < 4.0:
        return
    x, y = room.area.centre
    spread = [-2.0, 2.0] if max(wide, deep) > 7.0 else [0.0]
    for step in spread:
        at = (x, y + step) if deep > wide else (x + step, y)
        turn = (math.pi / 2 if deep > wide else 0.0) + float(furnishing.rng.uniform(-0.1, 0.1))
        parts = tuple(part.transformed(*at, turn) for part in table(furnishing.rng))
        furnishing.objects.append(SceneObject("table", parts, parts))


def _clear_paths(furnishing: Furnishing, room: PlanRoom, first: int) -> None:
    """Remove the last bulky objects until the doors and both ends of a room connect."""
    building = [part for part in wall_parts(furnishing.plan) if part.low < ROBOT_HEIGHT]
    while not _connected(furnishing, room, building):
        bulky = [
            k for k in range(first, len(furnishing.objects)) if furnishing.objects[k].name in _BULKY
        ]
        if not bulky:
            return
        del furnishing.objects[bulky[-1]]


def _connected(furnishing: Furnishing, room: PlanRoom, building: list[ScenePart]) -> bool:
    area, cells = room.area, round(BUILDING_SIZE / FLOOR_CELL)
    parts = [
        p for item in furnishing.objects for p in (*item.sim, *item.real) if p.low < ROBOT_HEIGHT
    ]
    free = clearance(footprint([*building, *parts], cells, FLOOR_CELL, 0.05)) >= CLEARANCE
    rows = slice(round(area.y0 / FLOOR_CELL), round(area.y1 / FLOOR_CELL))
    cols = slice(round(area.x0 / FLOOR_CELL), round(area.x1 / FLOOR_CELL))
    labels, _ = ndimage.label(free[rows, cols], structure=np.ones((3, 3)))
    upright = labels if labels.shape[0] >= labels.shape[1] else labels.T
    third = upright.shape[0] // 3
    connected = [upright[:third], upright[-third:]]  # the outer thirds along the longer side
    for door in furnishing.plan.doors_of(room.name):
        i, j = (int(v / FLOOR_CELL) - s.start for v, s in ((door.y, rows), (door.x, cols)))
        connected.append(labels[max(i - 4, 0) : i + 5, max(j - 4, 0) : j + 5])
    common = set(np.unique(connected[0])) - {0}
    for part in connected[1:]:
        common &= set(np.unique(part))
    return bool(common)
