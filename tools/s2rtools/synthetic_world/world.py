"""A world: a building with furniture, routes through it, and the real side of it by factors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Intrinsics
from s2rtools.synthetic_world import floor_plan as planning
from s2rtools.synthetic_world.factors import FACTORS, active
from s2rtools.synthetic_world.furnish import furnish
from s2rtools.synthetic_world.materials import Material
from s2rtools.synthetic_world.renderer import Camera, RayCaster, Renderer, Views
from s2rtools.synthetic_world.routes import BODY, CELL, Floor, Poses, drive
from s2rtools.synthetic_world.scene import Lamp, SceneObject, ScenePart, WorldScene, footprint

HFOV = 72.0
HEIGHT = 0.62
DEPTH_SCALE = 0.001
DEPTH_MAX = 10.0
TRAJECTORIES = {"traj1": "2026-03-02T10:00", "traj2": "2026-03-02T16:30"}
_NEAR = 0.75


class World:
    """One building, its two trajectories, and how either side of it looks."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.plan = planning.plan(seed)
        stops = {name: self._stops(number) for number, name in enumerate(TRAJECTORIES)}
        visited = _interleaved([room for room, _ in stops[name]] for name in TRAJECTORIES)
        wanted = {room for rooms in stops.values() for room, _ in rooms}
        closable = [
            door for door in self.plan.doors
            if not any(self.plan.room(name).is_corridor for name in door.rooms)
            and set(door.rooms) & wanted
        ]  # fmt: skip
        self.things: list[SceneObject] = furnish(self.plan, visited, closable, seed)
        self._stops_of = stops
        self._driven: dict[tuple[str, int], Poses] = {}

    @cached_property
    def floor(self) -> Floor:
        """Where the robot may drive, whichever side is the true one."""
        cells = round(planning.SIZE / CELL)
        parts = list(planning.walls(self.plan))
        for thing in self.things:
            parts += [*thing.sim, *thing.real]
        parts = [part for part in parts if part.low < BODY]
        taken = footprint(parts, cells, CELL, 0.05)
        taken[0, :] = taken[-1, :] = taken[:, 0] = taken[:, -1] = True
        return Floor(taken)

    def _stops(self, half: int) -> list[tuple[str, planning.Rectangle]]:
        """Rooms in the order in which a trajectory visits them: one half of the building each."""
        middle = planning.SIZE / 2
        rooms = [r for r in self.plan.rooms if not r.is_corridor]
        mine = [r for r in rooms if (r.area.centre[0] > middle) == bool(half)]
        mine.sort(
            key=lambda r: (
                math.atan2(r.area.centre[1] - middle, r.area.centre[0] - middle)
                if half
                else -math.atan2(r.area.centre[1] - middle, -r.area.centre[0] + middle)
            )
        )
        corridor = "east corridor" if half else "west corridor"
        upright = "south corridor" if half else "north corridor"
        seen = [self.plan.room(corridor), *mine[:3], self.plan.room(upright), *mine[3:],
                self.plan.room(corridor)]  # fmt: skip
        return [(room.name, room.area) for room in seen]

    def poses(self, trajectory: str, count: int) -> Poses:
        """`count` poses (n, 3) or a few less along a trajectory; not to be written to."""
        if (trajectory, count) not in self._driven:
            self._driven[trajectory, count] = poses = self._drive(trajectory, count)
            poses.flags.writeable = False
        return self._driven[trajectory, count]

    def _drive(self, trajectory: str, count: int) -> Poses:
        number = list(TRAJECTORIES).index(trajectory)
        stops = [
            self.floor.roomiest(half.x0, half.y0, half.x1, half.y1)
            for _, area in self._stops_of[trajectory] for half in area.ends()
        ]  # fmt: skip
        rng = np.random.default_rng([self.seed, 4, number])
        return drive(self.floor.way(stops), rng, count, self.sees)

    def tour(self, count: int) -> Poses:
        """`count` poses or a few less of a drive of its own through all rooms."""
        rng = np.random.default_rng([self.seed, 8])
        rooms = [room.area for room in self.plan.rooms]
        stops = [
            (float(rng.uniform(a.x0 + 0.5, a.x1 - 0.5)), float(rng.uniform(a.y0 + 0.5, a.y1 - 0.5)))
            for a in (rooms[int(k)] for k in rng.permutation(len(rooms)))
        ]
        return drive(self.floor.way(stops), rng, count, self.sees)

    def survey(self, count: int) -> Poses:
        """Random poses (count, 3) over the whole floor."""
        return self.floor.samples(np.random.default_rng([self.seed, 5, 0]), count, self.sees)

    def sees(self, poses: Poses) -> NDArray[np.bool_]:
        """Whether a view holds more than a near wall: on either side, by its depth."""
        camera = standard_camera(24)
        good = np.ones(len(poses), dtype=bool)
        for renderer in (self.renderer({}), self.renderer({"objects": 1.0})):
            depth = renderer.render(poses, camera, samples=0).depth
            near = (depth < _NEAR).mean(axis=(1, 2))
            good &= (near < 0.35) & (np.median(depth, axis=(1, 2)) > 1.4)
        return good

    def renderer(self, factors: Mapping[str, float], restored: int | None = None) -> Renderer:
        """The engine for one side; `restored` is the id of a thing that is as in simulation."""
        if restored is not None:
            return RayCaster(self.scene(factors, restored))
        return _renderer(self, tuple(sorted(factors.items())))

    def scene(self, factors: Mapping[str, float], restored: int | None = None) -> WorldScene:
        """One side's scene: the simulated one without factors."""
        changed = self.changed(factors)
        things = tuple(
            (number, thing.parts(number in changed and number != restored))
            for number, thing in enumerate(self.things, 1)
        )
        scene = self._bare
        for factor, severity in active(factors):
            scene = factor.scene(scene, severity)
        fixtures = tuple(_fixture(lamp) for lamp in scene.lamps if not lamp.window)
        return replace(scene, things=things, building=scene.building + fixtures)

    def changed(self, factors: Mapping[str, float]) -> list[int]:
        """Ids of the things that the real side has otherwise; the first share of them."""
        ids = [number for number, thing in enumerate(self.things, 1) if thing.change]
        return ids[: math.ceil(len(ids) * min(factors.get("objects", 0.0), 1.0))]

    @cached_property
    def _bare(self) -> WorldScene:
        cells = round(planning.SIZE / CELL)
        floor = np.zeros((cells, cells), dtype=np.uint8)
        for room in self.plan.rooms:
            a = room.area
            rows = slice(round(a.y0 / CELL), round(a.y1 / CELL))
            floor[rows, round(a.x0 / CELL) : round(a.x1 / CELL)] = room.floor
        return WorldScene(
            size=planning.SIZE,
            ceiling=planning.CEILING,
            building=planning.walls(self.plan),
            things=(),
            lamps=tuple(_lamps(self.plan)),
            floor=floor,
            floor_cell=CELL,
            palette=self.plan.palette,
        )


@lru_cache(maxsize=4)
def world_of(seed: int) -> World:
    """The world of a seed, furnished once per process."""
    return World(seed)


@lru_cache(maxsize=16)
def _renderer(world: World, factors: tuple[tuple[str, float], ...]) -> Renderer:
    """Engines keep what they make of their scene."""
    return RayCaster(world.scene(dict(factors)))


def standard_camera(frame: int) -> Camera:
    """The simulator's camera for square frames."""
    focal = frame / 2 / math.tan(math.radians(HFOV) / 2)
    lens = Intrinsics(focal, focal, frame / 2, frame / 2, 0.0)
    return Camera((frame, frame), lens, HEIGHT)


def side_camera(frame: int, factors: Mapping[str, float]) -> Camera:
    """The camera with what the factors do to it."""
    camera = standard_camera(frame)
    for factor, severity in active(factors):
        camera = factor.camera(camera, severity)
    return camera


def through_sensor(
    views: Views, factors: Mapping[str, float], seed: int, numbers: Iterable[int]
) -> Views:
    """What the factors' sensors make of rendered views; `numbers` seed the noise of each."""
    working = active(factors)
    rgb, depth = views.rgb.copy(), views.depth.copy()
    for row, number in enumerate(numbers):
        colour = views.rgb[row].astype(np.float32)
        metres = views.depth[row]
        for factor, severity in working:
            stream = [seed, 6, number, list(FACTORS).index(factor.name)]
            rng = np.random.default_rng(stream)
            colour = factor.rgb(colour, views.depth[row], rng, severity)
            metres = factor.depth(metres, rng, severity)
        rgb[row] = np.clip(colour + 0.5, 0, 255).astype(np.uint8)
        depth[row] = metres
    return Views(rgb, depth, views.identity)


def raw_depth(metres: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Millimetres as a depth camera's file holds them, 0 where there is no return."""
    seen = (metres > 0) & (metres <= DEPTH_MAX)
    return np.where(seen, np.rint(metres / DEPTH_SCALE), 0).astype(np.uint16)


def _lamps(plan: planning.BuildingPlan) -> Iterable[Lamp]:
    for room in plan.rooms:
        a = room.area
        nx, ny = (max(1, round(length / 2.6)) for length in (a.x1 - a.x0, a.y1 - a.y0))
        for i in range(nx):
            for j in range(ny):
                x, y = a.x0 + (i + 0.5) * (a.x1 - a.x0) / nx, a.y0 + (j + 0.5) * (a.y1 - a.y0) / ny
                yield Lamp(x, y, planning.CEILING - 0.05, (1.35, 1.30, 1.22))
        for wall, at in room.windows:
            x, y = a.on_wall(wall, at, 0.3)
            yield Lamp(x, y, 1.5, (0.5, 0.57, 0.68), window=True)


def _fixture(lamp: Lamp) -> ScenePart:
    strength = sum(lamp.power) / 3.87
    colour = tuple(0.30 + value / 1.35 * min(strength, 1.2) for value in lamp.power)
    return ScenePart(
        lamp.x, lamp.y, 0.55, 0.15, 2.66, 2.70, (colour[0], colour[1], colour[2]), Material.LAMP
    )


def _interleaved(lists: Iterable[list[str]]) -> list[str]:
    """Names in turn from each list, each once."""
    rows = list(lists)
    longest = max(map(len, rows))
    mixed = [row[k] for k in range(longest) for row in rows if k < len(row)]
    return list(dict.fromkeys(mixed))


def facts(world: World) -> list[dict[str, Any]]:
    """The labelled changes, for people: id, name, change and where it stands."""
    listed = []
    for number, thing in enumerate(world.things, 1):
        if thing.change:
            part = (thing.sim or thing.real)[0]
            listed.append({"object": number, "name": thing.name, "change": thing.change,
                           "x": round(part.x, 2), "y": round(part.y, 2)})  # fmt: skip
    return listed
