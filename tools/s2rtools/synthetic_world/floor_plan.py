"""Floor plan of a building: two crossing corridors and three rooms in each corner; its walls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from s2rtools.synthetic_world.materials import Material
from s2rtools.synthetic_world.scene_geometry import Colour, ScenePart

BUILDING_SIZE = 20.0
CEILING_HEIGHT = 2.7
HALF_WALL = 0.07
DOOR_WIDTH = 1.0
DOOR_HEIGHT = 2.08
SILL, HEAD = 0.9, 2.1

Wall = Literal["north", "south", "west", "east"]
WALLS: tuple[Wall, ...] = ("north", "south", "west", "east")

FRAME_COLOUR: Colour = (0.28, 0.24, 0.20)
_FRAME = 0.05


@dataclass(frozen=True, slots=True)
class Rectangle:
    """An axis-aligned rectangle in metres; y grows to the south."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def centre(self) -> tuple[float, float]:
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    def ends(self) -> tuple[Rectangle, Rectangle]:
        """The outer thirds along the longer side, 0.3 m from the walls."""
        x0, y0, x1, y1 = self.x0 + 0.3, self.y0 + 0.3, self.x1 - 0.3, self.y1 - 0.3
        wide, deep = (x1 - x0) / 3, (y1 - y0) / 3
        if wide > deep:
            return Rectangle(x0, y0, x0 + wide, y1), Rectangle(x1 - wide, y0, x1, y1)
        return Rectangle(x0, y0, x1, y0 + deep), Rectangle(x0, y1 - deep, x1, y1)

    def length(self, wall: Wall) -> float:
        return self.x1 - self.x0 if wall in ("north", "south") else self.y1 - self.y0

    def on_wall(self, wall: Wall, at: float, out: float = 0.0) -> tuple[float, float]:
        """The point `at` metres along a wall from its west or north end, `out` into the room."""
        if wall in ("north", "south"):
            return self.x0 + at, self.y0 + out if wall == "north" else self.y1 - out
        return (self.x0 + out if wall == "west" else self.x1 - out), self.y0 + at


WALL_ANGLES: dict[Wall, float] = {
    "north": 0.0, "south": math.pi, "east": math.pi / 2, "west": -math.pi / 2,
}  # fmt: skip
"""Rotation of a piece of furniture, whose back is at y = 0, that puts its back to a wall."""


@dataclass(frozen=True, slots=True)
class Door:
    """An opening at (x, y) in a wall that runs along x (`flat`) or along y, between two `rooms`.

    The leaf hangs in the first room, hinged at the end of the smaller coordinate.
    """

    x: float
    y: float
    flat: bool
    rooms: tuple[str, str]


@dataclass(frozen=True, slots=True)
class PlanRoom:
    """A room or a piece of corridor. `open_walls` have no wall; `windows` are (wall, middle)."""

    name: str
    kind: str
    area: Rectangle
    colour: Colour
    floor: int
    open_walls: tuple[Wall, ...] = ()
    windows: tuple[tuple[Wall, float], ...] = ()

    @property
    def is_corridor(self) -> bool:
        return self.kind == "corridor"


@dataclass(frozen=True, slots=True)
class BuildingPlan:
    rooms: tuple[PlanRoom, ...]
    doors: tuple[Door, ...]
    palette: tuple[tuple[Material, Colour, int], ...]

    def room(self, name: str) -> PlanRoom:
        return next(room for room in self.rooms if room.name == name)

    def doors_of(self, name: str) -> list[Door]:
        return [door for door in self.doors if name in door.rooms]


ROOM_KINDS = (
    "office", "studio", "meeting", "kitchen", "lounge", "library",
    "laboratory", "servers", "copy", "workshop", "reception", "archive",
)  # fmt: skip

_PALETTE: tuple[tuple[Material, Colour, int], ...] = (
    (Material.LINOLEUM, (0.44, 0.45, 0.43), 1),
    (Material.PLANKS, (0.48, 0.29, 0.14), 2),
    (Material.CARPET, (0.16, 0.22, 0.36), 3),
    (Material.CARPET, (0.34, 0.30, 0.26), 4),
    (Material.CARPET, (0.38, 0.12, 0.12), 5),
    (Material.TILES, (0.72, 0.71, 0.67), 7),
    (Material.TILES, (0.52, 0.58, 0.60), 6),
    (Material.PLANKS, (0.62, 0.48, 0.30), 8),
    (Material.CARPET, (0.14, 0.30, 0.20), 9),
    (Material.LINOLEUM, (0.30, 0.36, 0.40), 10),
)
_FLOORS = {
    "office": 2, "studio": 3, "meeting": 4, "kitchen": 5, "lounge": 7, "library": 8,
    "laboratory": 6, "servers": 9, "copy": 0, "workshop": 0, "reception": 3, "archive": 9,
}  # fmt: skip
_PAINTS: tuple[Colour, ...] = (
    (0.78, 0.76, 0.70), (0.62, 0.72, 0.78), (0.80, 0.70, 0.52), (0.60, 0.74, 0.62),
    (0.80, 0.60, 0.54), (0.74, 0.66, 0.78), (0.82, 0.80, 0.62), (0.55, 0.66, 0.70),
    (0.76, 0.78, 0.78), (0.70, 0.58, 0.46), (0.60, 0.62, 0.72), (0.80, 0.74, 0.76),
)  # fmt: skip


def plan_building(seed: int) -> BuildingPlan:
    """The building of a seed."""
    rng = np.random.default_rng([seed, 1])
    west, north = (float(rng.uniform(8.4, 9.7)) for _ in range(2))
    east, south = west + 1.9, north + 2.1
    kinds = [str(kind) for kind in rng.permutation(ROOM_KINDS)]
    paints = [_PAINTS[int(i)] for i in rng.permutation(len(_PAINTS))]
    rooms: list[PlanRoom] = []
    doors: list[Door] = []
    corners = (
        (Rectangle(0, 0, west, north), False, False),
        (Rectangle(east, 0, BUILDING_SIZE, north), True, False),
        (Rectangle(0, south, west, BUILDING_SIZE), False, True),
        (Rectangle(east, south, BUILDING_SIZE, BUILDING_SIZE), True, True),
    )
    for number, (area, is_east, is_south) in enumerate(corners):
        names = kinds[3 * number : 3 * number + 3]
        cut = _split_corner(rng, area, is_east, is_south)
        for name, part, paint in zip(names, cut, paints[3 * number :], strict=False):
            rooms.append(PlanRoom(name, name, part, paint, _FLOORS[name], (), _windows(part)))
        doors += _doors(rng, names, cut, is_east, is_south)
    rooms += _corridors(west, east, north, south)
    return BuildingPlan(tuple(rooms), tuple(doors), _PALETTE)


def _split_corner(
    rng: np.random.Generator, area: Rectangle, is_east: bool, is_south: bool
) -> tuple[Rectangle, Rectangle, Rectangle]:
    """Split a corner into the far room, the room at the outer wall and the room at the crossing.

    The far room borders the flat corridor, the outer room borders the upright corridor.
    """
    split = (area.x1 - area.x0) * float(rng.uniform(0.44, 0.54))
    level = (area.y1 - area.y0) * float(rng.uniform(0.44, 0.56))
    s = area.x1 - split if is_east else area.x0 + split
    t = area.y0 + level
    x0, x1 = (area.x0, s) if is_east else (s, area.x1)
    far_x0, far_x1 = (s, area.x1) if is_east else (area.x0, s)
    far = Rectangle(far_x0, area.y0, far_x1, area.y1)
    upper, lower = Rectangle(x0, area.y0, x1, t), Rectangle(x0, t, x1, area.y1)
    return (far, lower, upper) if is_south else (far, upper, lower)


def _doors(
    rng: np.random.Generator,
    names: list[str],
    cut: tuple[Rectangle, Rectangle, Rectangle],
    is_east: bool,
    is_south: bool,
) -> list[Door]:
    far, outer, near = cut
    flat_y = far.y0 if is_south else far.y1
    upright_x = outer.x0 if is_east else outer.x1
    flat_name = "east corridor" if is_east else "west corridor"
    upright_name = "south corridor" if is_south else "north corridor"

    def between(a: float, b: float) -> float:
        return float(rng.uniform(a + 1.1, b - 1.1))

    return [
        Door(between(far.x0, far.x1), flat_y, True, (names[0], flat_name)),
        Door(upright_x, between(outer.y0, outer.y1), False, (names[1], upright_name)),
        Door(between(near.x0, near.x1), flat_y, True, (names[2], flat_name)),
        Door(between(near.x0, near.x1), outer.y0 if is_south else outer.y1, True,
             (names[2], names[1])),
    ]  # fmt: skip


def _windows(area: Rectangle) -> tuple[tuple[Wall, float], ...]:
    """Windows spread evenly along the outer walls."""
    windows: list[tuple[Wall, float]] = []
    for wall in WALLS:
        if _is_outer(area, wall):
            length = area.length(wall)
            count = int((length - 1.0) // 2.6)
            windows += [(wall, length * (k + 0.5) / count) for k in range(count)]
    return tuple(windows)


WINDOW_WIDTH = 1.8


def _corridors(west: float, east: float, north: float, south: float) -> list[PlanRoom]:
    paint: Colour = (0.74, 0.75, 0.72)
    warm: Colour = (0.78, 0.72, 0.62)
    pieces: list[tuple[str, Rectangle, Colour, int, tuple[Wall, ...]]] = [
        ("west corridor", Rectangle(0, north, west, south), paint, 0, ("east",)),
        ("east corridor", Rectangle(east, north, BUILDING_SIZE, south), paint, 0, ("west",)),
        ("north corridor", Rectangle(west, 0, east, north), warm, 1, ("south",)),
        ("south corridor", Rectangle(west, south, east, BUILDING_SIZE), warm, 1, ("north",)),
        ("crossing", Rectangle(west, north, east, south), paint, 0, WALLS),
    ]
    rooms = []
    for name, area, colour, floor, open_walls in pieces:
        outer = [wall for wall in WALLS if wall not in open_walls and _is_outer(area, wall)]
        windows = tuple((wall, area.length(wall) / 2) for wall in outer)
        rooms.append(PlanRoom(name, "corridor", area, colour, floor, open_walls, windows))
    return rooms


def _is_outer(area: Rectangle, wall: Wall) -> bool:
    end = BUILDING_SIZE
    distance = {"north": area.y0, "west": area.x0, "south": end - area.y1, "east": end - area.x1}
    return distance[wall] < 0.01


def door_openings(plan: BuildingPlan, room: PlanRoom, wall: Wall) -> list[tuple[float, Door]]:
    """Doors in a wall of a room, each with its middle in metres along the wall."""
    area, doors = room.area, []
    for door in plan.doors_of(room.name):
        flat = wall in ("north", "south")
        if door.flat != flat:
            continue
        line = {"north": area.y0, "south": area.y1, "west": area.x0, "east": area.x1}[wall]
        if abs((door.y if flat else door.x) - line) < 0.01:
            doors.append((door.x - area.x0 if flat else door.y - area.y0, door))
    return doors


def wall_parts(plan: BuildingPlan) -> tuple[ScenePart, ...]:
    """Walls of all rooms, each half a wall thick, with openings for doors and windows."""
    parts: list[ScenePart] = []
    for room in plan.rooms:
        for wall in WALLS:
            if wall not in room.open_walls:
                parts += _wall(plan, room, wall)
    for door in plan.doors:
        parts += _door_frame(door)
    return tuple(parts)


def _wall(plan: BuildingPlan, room: PlanRoom, wall: Wall) -> list[ScenePart]:
    length = room.area.length(wall)
    cuts = [(at - DOOR_WIDTH / 2, at + DOOR_WIDTH / 2, 0.0, DOOR_HEIGHT)
            for at, _ in door_openings(plan, room, wall)]  # fmt: skip
    cuts += [(at - WINDOW_WIDTH / 2, at + WINDOW_WIDTH / 2, SILL, HEAD)
             for w, at in room.windows if w == wall]  # fmt: skip
    parts, start = [], 0.0
    for a, b, low, high in sorted(cuts):
        parts.append(_wall_slab(room, wall, start, a, 0.0, CEILING_HEIGHT))
        parts.append(_wall_slab(room, wall, a, b, high, CEILING_HEIGHT))
        if low > 0:
            parts.append(_wall_slab(room, wall, a, b, 0.0, low))
            parts.append(_wall_slab(room, wall, a, b, low, high, Material.WINDOW))
        start = b
    parts.append(_wall_slab(room, wall, start, length, 0.0, CEILING_HEIGHT))
    return parts


def _wall_slab(
    room: PlanRoom, wall: Wall, a: float, b: float, low: float, high: float,
    material: Material = Material.PLASTER,
) -> ScenePart:  # fmt: skip
    x, y = room.area.on_wall(wall, (a + b) / 2, HALF_WALL / 2)
    half, thin = (b - a) / 2, HALF_WALL / 2
    along_x = wall in ("north", "south")
    colour = (1.0, 1.0, 1.0) if material == Material.WINDOW else room.colour
    seed = 1 + sum(map(ord, room.name))
    return ScenePart(x, y, half if along_x else thin, thin if along_x else half,
                low, high, colour, material, seed=seed)  # fmt: skip


def _door_frame(door: Door) -> list[ScenePart]:
    """Posts and lintel of a door opening."""
    parts = []
    reach, thick = DOOR_WIDTH / 2, HALF_WALL + 0.02
    for along, half, low in (
        (-reach, _FRAME / 2, 0.0), (reach, _FRAME / 2, 0.0), (0.0, reach, DOOR_HEIGHT)
    ):  # fmt: skip
        x, y = (door.x + along, door.y) if door.flat else (door.x, door.y + along)
        halves = (half, thick) if door.flat else (thick, half)
        parts.append(ScenePart(x, y, *halves, low, DOOR_HEIGHT + 0.05, FRAME_COLOUR, Material.WOOD))
    return parts


def door_leaf(plan: BuildingPlan, door: Door, is_open: bool) -> ScenePart:
    """The leaf of a door: in its frame, or swung back along the wall of the first room."""
    room = plan.room(door.rooms[0]).area
    width = DOOR_WIDTH - 0.06
    reach = DOOR_WIDTH / 2
    sign = 1.0 if (room.centre[1] > door.y if door.flat else room.centre[0] > door.x) else -1.0
    seed = 1 + sum(map(ord, door.rooms[0]))
    colour = _PAINTS[seed % len(_PAINTS)]
    tint = (colour[0] * 0.75, colour[1] * 0.6, colour[2] * 0.45)
    along, out, tilt = 0.0, 0.0, 0.0
    if is_open:
        tilt = math.radians(12)
        along = -reach - math.cos(tilt) * width / 2
        out = sign * (HALF_WALL + 0.03 + math.sin(tilt) * width / 2)
    if door.flat:
        x, y, turned = door.x + along, door.y + out, -sign * tilt
    else:
        x, y, turned = door.x + out, door.y + along, math.pi / 2 + sign * tilt
    return ScenePart(x, y, width / 2, 0.02, 0.01, DOOR_HEIGHT - 0.02, tint, Material.DOOR,
                     angle=turned, seed=seed)  # fmt: skip
