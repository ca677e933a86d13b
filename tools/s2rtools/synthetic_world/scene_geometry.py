"""Scenes: parts of simple shapes, grouped into identified objects, and their packed arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from s2rtools.synthetic_world.materials import Material

Colour = tuple[float, float, float]


class Shape(IntEnum):
    """BOX fills its rectangle, PILLAR the ellipse in it; BUSH is an ellipsoid with holes; WHEEL is
    an upright ring with spokes in the x-z plane of its box.
    """

    BOX = 0
    PILLAR = 1
    BUSH = 2
    WHEEL = 3


@dataclass(frozen=True, slots=True)
class ScenePart:
    """A shape about a vertical axis: centre and half sizes in metres, angle in radians."""

    x: float
    y: float
    half_x: float
    half_y: float
    low: float
    high: float
    colour: Colour
    material: Material = Material.PAINT
    shape: Shape = Shape.BOX
    angle: float = 0.0
    seed: int = 0

    def transformed(self, x: float, y: float, angle: float) -> ScenePart:
        """The part rotated by `angle` about the origin and then moved by (x, y)."""
        cos, sin = math.cos(angle), math.sin(angle)
        return replace(
            self,
            x=x + self.x * cos - self.y * sin,
            y=y + self.x * sin + self.y * cos,
            angle=self.angle + angle,
        )


@dataclass(frozen=True, slots=True)
class SceneObject:
    """Parts that belong together; `change` names how the real side differs, if it does.

    `sim` and `real` are the parts on either side; empty where the object is absent.
    """

    name: str
    sim: tuple[ScenePart, ...]
    real: tuple[ScenePart, ...]
    change: str | None = None

    def parts(self, changed: bool) -> tuple[ScenePart, ...]:
        return self.real if changed else self.sim


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light at the ceiling or, with `height` under 2 m, in a window; linear RGB power."""

    x: float
    y: float
    height: float
    power: Colour
    window: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class WorldScene:
    """One side of a world, ready for a renderer.

    `objects` are (id, parts), ids from 1; 0 is the building. `floor` [y, x] holds a palette row
    per cell of `floor_cell` metres. `lamp_power` and `window_power` are factors of the light of
    the lamps at the ceiling and in windows.
    """

    size: float
    ceiling: float
    building: tuple[ScenePart, ...]
    objects: tuple[tuple[int, tuple[ScenePart, ...]], ...]
    lamps: tuple[Lamp, ...]
    floor: NDArray[np.uint8]
    floor_cell: float
    palette: tuple[tuple[Material, Colour, int], ...]
    ambient: Colour = (0.34, 0.34, 0.35)
    lamp_power: float = 1.0
    window_power: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class PackedScene:
    """A scene's parts as arrays, and a grid with the parts that may reach into each cell.

    `numbers` (P, 12): x, y, cos, sin, half_x, half_y, low, high, r, g, b, outer radius;
    `codes` (P, 4): shape, material, object id, seed. `start` (cells + 1,) and `members` list the
    parts of each cell, row by row.
    """

    numbers: NDArray[np.float64]
    codes: NDArray[np.int64]
    start: NDArray[np.int32]
    members: NDArray[np.int32]
    cell: float
    cells: int


GRID_CELL = 0.25


def pack_scene(scene: WorldScene) -> PackedScene:
    """Convert a scene into arrays for the ray caster."""
    parts = [(0, part) for part in scene.building]
    parts += [(number, part) for number, object_parts in scene.objects for part in object_parts]
    numbers = np.array([_numbers(part) for _, part in parts], dtype=np.float64).reshape(-1, 12)
    codes = np.array(
        [(part.shape, part.material, number, part.seed) for number, part in parts], dtype=np.int64
    ).reshape(-1, 4)
    cells = math.ceil(scene.size / GRID_CELL)
    lists: list[list[int]] = [[] for _ in range(cells * cells)]
    for index, (_, part) in enumerate(parts):
        for row, col in _touched(part, cells):
            lists[row * cells + col].append(index)
    start = np.zeros(cells * cells + 1, dtype=np.int32)
    start[1:] = np.cumsum([len(indices) for indices in lists])
    members = np.array([index for indices in lists for index in indices], dtype=np.int32)
    return PackedScene(numbers, codes, start, members, GRID_CELL, cells)


def _numbers(part: ScenePart) -> tuple[float, ...]:
    return (
        part.x, part.y, math.cos(part.angle), math.sin(part.angle), part.half_x, part.half_y,
        part.low, part.high, *part.colour, math.hypot(part.half_x, part.half_y),
    )  # fmt: skip


def _touched(part: ScenePart, cells: int) -> list[tuple[int, int]]:
    """Cells that the part's rotated rectangle may reach."""
    cos, sin = abs(math.cos(part.angle)), abs(math.sin(part.angle))
    reach_x = part.half_x * cos + part.half_y * sin + 1e-6
    reach_y = part.half_x * sin + part.half_y * cos + 1e-6
    first_col, last_col = _span(part.x, reach_x, cells)
    first_row, last_row = _span(part.y, reach_y, cells)
    half = GRID_CELL * 0.5 * (cos + sin)
    touched = []
    for row in range(first_row, last_row + 1):
        for col in range(first_col, last_col + 1):
            dx, dy = (col + 0.5) * GRID_CELL - part.x, (row + 0.5) * GRID_CELL - part.y
            along = dx * math.cos(part.angle) + dy * math.sin(part.angle)
            across = -dx * math.sin(part.angle) + dy * math.cos(part.angle)
            if abs(along) <= part.half_x + half and abs(across) <= part.half_y + half:
                touched.append((row, col))
    return touched


def _span(centre: float, reach: float, cells: int) -> tuple[int, int]:
    first = math.floor((centre - reach) / GRID_CELL)
    last = math.floor((centre + reach) / GRID_CELL)
    return max(first, 0), min(last, cells - 1)


def footprint(
    parts: Sequence[ScenePart], cells: int, cell: float, above: float
) -> NDArray[np.bool_]:
    """Floor cells [y, x] covered by parts that reach higher than `above` metres."""
    taken = np.zeros((cells, cells), dtype=bool)
    for part in parts:
        if part.high <= above:
            continue
        reach = math.hypot(part.half_x, part.half_y)
        x0, x1 = _clip(part.x - reach, cells, cell), _clip(part.x + reach, cells, cell)
        y0, y1 = _clip(part.y - reach, cells, cell), _clip(part.y + reach, cells, cell)
        xs = (np.arange(x0, x1 + 1) + 0.5) * cell - part.x
        ys = (np.arange(y0, y1 + 1) + 0.5) * cell - part.y
        cos, sin = math.cos(part.angle), math.sin(part.angle)
        along = xs[None, :] * cos + ys[:, None] * sin
        across = -xs[None, :] * sin + ys[:, None] * cos
        slack = cell * 0.5
        taken[y0 : y1 + 1, x0 : x1 + 1] |= (np.abs(along) <= part.half_x + slack) & (
            np.abs(across) <= part.half_y + slack
        )
    return taken


def _clip(value: float, cells: int, cell: float) -> int:
    return min(max(math.floor(value / cell), 0), cells - 1)
