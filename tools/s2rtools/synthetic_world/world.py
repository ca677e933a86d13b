"""A world: a furnished building, routes through it, and its real side as changed by factors."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Intrinsics
from s2rtools.synthetic_world import floor_plan as planning
from s2rtools.synthetic_world.factors import FACTORS, Factor, active_factors
from s2rtools.synthetic_world.furnish import furnish
from s2rtools.synthetic_world.materials import Material
from s2rtools.synthetic_world.renderer import Camera, RayCaster, RenderedViews, SceneRenderer
from s2rtools.synthetic_world.routes import (
    FLOOR_CELL,
    ROBOT_HEIGHT,
    DrivableFloor,
    Poses,
    drive_along,
)
from s2rtools.synthetic_world.scene_geometry import (
    Lamp,
    SceneObject,
    ScenePart,
    WorldScene,
    footprint,
)

CAMERA_HFOV = 72.0
CAMERA_HEIGHT = 0.62
DEPTH_SCALE = 0.001
DEPTH_MAX = 10.0
TRAJECTORIES = {"traj1": "2026-03-02T10:00", "traj2": "2026-03-02T16:30"}
_NEAR = 0.75


class World:
    """One building, its two trajectories and the scene of either side."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.plan = planning.plan_building(seed)
        stops = {name: self._stops(number) for number, name in enumerate(TRAJECTORIES)}
        in_turn = [stop for pair in zip_longest(*stops.values()) for stop in pair if stop]
        visited = list(dict.fromkeys(room for room, _ in in_turn))
        closable = [
            door for door in self.plan.doors
            if not any(self.plan.room(name).is_corridor for name in door.rooms)
            and set(door.rooms) & set(visited)
        ]  # fmt: skip
        self.objects: list[SceneObject] = furnish(self.plan, visited, closable, seed)
        self._stops_of = stops
        self._driven_poses: dict[tuple[str, int], Poses] = {}

    @cached_property
    def floor(self) -> DrivableFloor:
        """Space that is free on both sides."""
        cells = round(planning.BUILDING_SIZE / FLOOR_CELL)
        parts = list(planning.wall_parts(self.plan))
        for item in self.objects:
            parts += [*item.sim, *item.real]
        parts = [part for part in parts if part.low < ROBOT_HEIGHT]
        taken = footprint(parts, cells, FLOOR_CELL, 0.05)
        taken[0, :] = taken[-1, :] = taken[:, 0] = taken[:, -1] = True
        return DrivableFloor(taken)

    def _stops(self, half: int) -> list[tuple[str, planning.Rectangle]]:
        """Rooms in the order of a trajectory's visits; each trajectory covers half the building."""
        middle = planning.BUILDING_SIZE / 2
        rooms = [r for r in self.plan.rooms if not r.is_corridor]
        own_rooms = [r for r in rooms if (r.area.centre[0] > middle) == bool(half)]
        own_rooms.sort(
            key=lambda r: (
                math.atan2(r.area.centre[1] - middle, r.area.centre[0] - middle)
                if half
                else -math.atan2(r.area.centre[1] - middle, -r.area.centre[0] + middle)
            )
        )
        corridor = "east corridor" if half else "west corridor"
        upright = "south corridor" if half else "north corridor"
        ends, middle_stop = self.plan.room(corridor), self.plan.room(upright)
        visited = [ends, *own_rooms[:3], middle_stop, *own_rooms[3:], ends]
        return [(room.name, room.area) for room in visited]

    def poses(self, trajectory: str, count: int) -> Poses:
        """At most `count` poses (n, 3) along a trajectory, as a read-only array."""
        if (trajectory, count) not in self._driven_poses:
            self._driven_poses[trajectory, count] = poses = self._drive(trajectory, count)
            poses.flags.writeable = False
        return self._driven_poses[trajectory, count]

    def _drive(self, trajectory: str, count: int) -> Poses:
        number = list(TRAJECTORIES).index(trajectory)
        stops = [
            self.floor.most_open_point(half.x0, half.y0, half.x1, half.y1)
            for _, area in self._stops_of[trajectory] for half in area.ends()
        ]  # fmt: skip
        rng = np.random.default_rng([self.seed, 4, number])
        return drive_along(self.floor.route(stops), rng, count, self.has_content)

    def tour(self, count: int) -> Poses:
        """At most `count` poses of a separate drive through all rooms."""
        rng = np.random.default_rng([self.seed, 8])
        rooms = [room.area for room in self.plan.rooms]
        stops = [
            (float(rng.uniform(a.x0 + 0.5, a.x1 - 0.5)), float(rng.uniform(a.y0 + 0.5, a.y1 - 0.5)))
            for a in (rooms[int(k)] for k in rng.permutation(len(rooms)))
        ]
        return drive_along(self.floor.route(stops), rng, count, self.has_content)

    def survey(self, count: int) -> Poses:
        """Random poses (count, 3) over the whole floor."""
        return self.floor.samples(np.random.default_rng([self.seed, 5, 0]), count, self.has_content)

    def has_content(self, poses: Poses) -> NDArray[np.bool_]:
        """Whether the depth of a view, on both sides, shows more than a near wall."""
        camera = standard_camera(24)
        good = np.ones(len(poses), dtype=bool)
        for renderer in (self.renderer({}), self.renderer({"objects": 1.0})):
            depth = renderer.render(poses, camera, samples=0).depth
            near = (depth < _NEAR).mean(axis=(1, 2))
            good &= (near < 0.35) & (np.median(depth, axis=(1, 2)) > 1.4)
        return good

    def renderer(
        self, factors: Mapping[str, float], restored: Collection[int] = ()
    ) -> SceneRenderer:
        """Renderer of one side; the objects with the ids `restored` stay as in simulation."""
        if restored:
            return RayCaster(self.scene(factors, restored))
        return _renderer(self, tuple(sorted(factors.items())))

    def lit_renderer(
        self, factors: Mapping[str, float], lamps: float, windows: float
    ) -> SceneRenderer:
        """Renderer of one side with factors of the light of its lamps and of its windows."""
        if lamps == windows == 1:
            return self.renderer(factors)
        return _lit_renderer(self, tuple(sorted(factors.items())), lamps, windows)

    def scene(self, factors: Mapping[str, float], restored: Collection[int] = ()) -> WorldScene:
        """Scene of one side; without factors, the simulated one."""
        changed = set(self.changed_objects(factors)) - set(restored)
        objects = tuple(
            (number, item.parts(number in changed)) for number, item in enumerate(self.objects, 1)
        )
        scene = self._bare
        for factor, severity in active_factors(factors):
            scene = factor.scene(scene, severity)
        fixtures = tuple(_lamp_fixture(lamp) for lamp in scene.lamps if not lamp.window)
        return replace(scene, objects=objects, building=scene.building + fixtures)

    def changed_objects(self, factors: Mapping[str, float]) -> list[int]:
        """Ids of the objects that differ on the real side: the first share of them."""
        ids = [number for number, item in enumerate(self.objects, 1) if item.change]
        return ids[: math.ceil(len(ids) * min(factors.get("objects", 0.0), 1.0))]

    @cached_property
    def _bare(self) -> WorldScene:
        cells = round(planning.BUILDING_SIZE / FLOOR_CELL)
        floor = np.zeros((cells, cells), dtype=np.uint8)
        for room in self.plan.rooms:
            a = room.area
            rows = slice(round(a.y0 / FLOOR_CELL), round(a.y1 / FLOOR_CELL))
            floor[rows, round(a.x0 / FLOOR_CELL) : round(a.x1 / FLOOR_CELL)] = room.floor
        return WorldScene(
            size=planning.BUILDING_SIZE,
            ceiling=planning.CEILING_HEIGHT,
            building=planning.wall_parts(self.plan),
            objects=(),
            lamps=tuple(_lamps(self.plan)),
            floor=floor,
            floor_cell=FLOOR_CELL,
            palette=self.plan.palette,
        )


@lru_cache(maxsize=4)
def world_of(seed: int) -> World:
    """The world of a seed, built once per process."""
    return World(seed)


@lru_cache(maxsize=16)
def _renderer(world: World, factors: tuple[tuple[str, float], ...]) -> SceneRenderer:
    """Cached, because a renderer keeps the arrays that it prepares for its scene."""
    return RayCaster(world.scene(dict(factors)))


@lru_cache(maxsize=4)
def _lit_renderer(
    world: World, factors: tuple[tuple[str, float], ...], lamps: float, windows: float
) -> SceneRenderer:
    scene = world.scene(dict(factors))
    return RayCaster(replace(scene, lamp_power=lamps, window_power=windows))


def standard_camera(frame: int) -> Camera:
    """Camera of the simulator, for square frames."""
    focal = frame / 2 / math.tan(math.radians(CAMERA_HFOV) / 2)
    lens = Intrinsics(focal, focal, frame / 2, frame / 2, 0.0)
    return Camera((frame, frame), lens, CAMERA_HEIGHT)


def side_camera(
    frame: int, factors: Mapping[str, float], registry: Mapping[str, Factor] = FACTORS
) -> Camera:
    """The simulator's camera as the factors of `registry`, with their constants, change it."""
    camera = standard_camera(frame)
    for factor, severity in active_factors(factors, registry):
        camera = factor.camera(camera, severity)
    return camera


def apply_sensor_factors(
    views: RenderedViews,
    factors: Mapping[str, float],
    seed: int,
    numbers: Iterable[int],
    registry: Mapping[str, Factor] = FACTORS,
) -> RenderedViews:
    """Apply the sensor effects of factors to rendered views; `numbers` seed the noise of each.

    `registry` holds the factors with their constants.
    """
    applied = active_factors(factors, registry)
    rgb, depth = views.rgb.copy(), views.depth.copy()
    for row, number in enumerate(numbers):
        colour = views.rgb[row].astype(np.float32)
        metres = views.depth[row]
        for factor, severity in applied:
            rng = np.random.default_rng([seed, 6, number, list(FACTORS).index(factor.name)])
            colour = factor.rgb(colour, views.depth[row], rng, severity)
            metres = factor.depth(metres, rng, severity)
        rgb[row] = np.clip(colour + 0.5, 0, 255).astype(np.uint8)
        depth[row] = metres
    return RenderedViews(rgb, depth, views.identity)


def to_raw_depth(metres: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Depth in millimetres, as a depth camera stores it; 0 where there is no return."""
    valid = (metres > 0) & (metres <= DEPTH_MAX)
    return np.where(valid, np.rint(metres / DEPTH_SCALE), 0).astype(np.uint16)


def _lamps(plan: planning.BuildingPlan) -> Iterable[Lamp]:
    for room in plan.rooms:
        a = room.area
        nx, ny = (max(1, round(length / 2.6)) for length in (a.x1 - a.x0, a.y1 - a.y0))
        for i in range(nx):
            for j in range(ny):
                x, y = a.x0 + (i + 0.5) * (a.x1 - a.x0) / nx, a.y0 + (j + 0.5) * (a.y1 - a.y0) / ny
                yield Lamp(x, y, planning.CEILING_HEIGHT - 0.05, (1.35, 1.30, 1.22))
        for wall, at in room.windows:
            x, y = a.on_wall(wall, at, 0.3)
            yield Lamp(x, y, 1.5, (0.5, 0.57, 0.68), window=True)


def _lamp_fixture(lamp: Lamp) -> ScenePart:
    strength = sum(lamp.power) / 3.87
    colour = tuple(0.30 + value / 1.35 * min(strength, 1.2) for value in lamp.power)
    return ScenePart(
        lamp.x, lamp.y, 0.55, 0.15, 2.66, 2.70, (colour[0], colour[1], colour[2]), Material.LAMP
    )


def labelled_changes(world: World) -> list[dict[str, Any]]:
    """The labelled changes for the provenance: id, name, change and position of each object."""
    changes = []
    for number, item in enumerate(world.objects, 1):
        if item.change:
            part = (item.sim or item.real)[0]
            changes.append({"object": number, "name": item.name, "change": item.change,
                           "x": round(part.x, 2), "y": round(part.y, 2)})  # fmt: skip
    return changes
