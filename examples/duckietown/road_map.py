"""A flat town of square road tiles: where which line lies, and the paths of the right-hand lanes.

A map is a grid of box-drawing characters; a tile is connected to the neighbours that its character
points to. Roads have white solid borders and a yellow dashed centre line; intersections have red
stop lines. Coordinates are metres, x to the right and y up, the origin at the lower left corner of
the grid. Sizes are those of a Duckietown road within a few millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Coverage = NDArray[np.uint8]
Direction = tuple[int, int]
Step = tuple[tuple[int, int], Direction, Direction]
"""A tile (column, row), the direction of travel at its entry, and that at its exit."""

TILE = 0.61
WHITE_WIDTH = 0.048
YELLOW_WIDTH = 0.024
RED_WIDTH = 0.048
WHITE_OFFSET = 0.2465
"""Distance of the middle of a white line from the middle of the road."""
LANE_OFFSET = 0.1172
"""Distance of the middle of a lane from the middle of the road."""
_DASH, _GAP = 0.050, 0.025

PIXELS_PER_METRE = 400
_SUPERSAMPLING = 4
_PATH_STEP = 0.01

EAST, NORTH, WEST, SOUTH = (1, 0), (0, 1), (-1, 0), (0, -1)
CONNECTIONS: dict[str, frozenset[Direction]] = {
    "─": frozenset({EAST, WEST}), "│": frozenset({NORTH, SOUTH}),
    "┌": frozenset({EAST, SOUTH}), "┐": frozenset({WEST, SOUTH}),
    "└": frozenset({EAST, NORTH}), "┘": frozenset({WEST, NORTH}),
    "├": frozenset({EAST, NORTH, SOUTH}), "┤": frozenset({WEST, NORTH, SOUTH}),
    "┬": frozenset({EAST, WEST, SOUTH}), "┴": frozenset({EAST, WEST, NORTH}),
    "┼": frozenset({EAST, NORTH, WEST, SOUTH}), " ": frozenset(),
}  # fmt: skip
LAYOUTS = (
    ("┌─┬─┐", "│ │ │", "├─┼─┤", "│ │ │", "└─┴─┘"),
    ("┌──┬┐", "│┌┐││", "││└┘│", "│└┐┌┘", "└─┴┘ "),
    ("┌┐┌─┐", "│└┘ │", "├─┬─┤", "│ │ │", "└─┴─┘"),
)


@dataclass(frozen=True, slots=True, eq=False)
class RoadMap:
    """`tiles` by (column, row from below) and their connections; `coverage` (h, w, 4) uint8 are the
    shares of white, yellow, red and tile surface of each map pixel, row 0 at y = 0."""

    columns: int
    rows: int
    tiles: dict[tuple[int, int], frozenset[Direction]]
    coverage: Coverage

    def path(self, rng: np.random.Generator, length: float) -> Floats:
        """Middle of the lane (n, 3) along random turns: x, y, heading in radians, every 10 mm."""
        places = sorted(self.tiles)
        place = places[int(rng.integers(len(places)))]
        inward = sorted((-a, -b) for a, b in self.tiles[place])
        entry = inward[int(rng.integers(len(inward)))]
        pieces: list[Floats] = []
        covered = 0.0
        while covered < length:
            exits = sorted(self.tiles[place] - {(-entry[0], -entry[1])})
            leave = exits[int(rng.integers(len(exits)))]
            piece = lane_piece((place, entry, leave))
            pieces.append(piece)
            covered += len(piece) * _PATH_STEP
            place, entry = (place[0] + leave[0], place[1] + leave[1]), leave
        path = np.concatenate(pieces)[: max(2, round(length / _PATH_STEP))]
        path[:, 2] = np.unwrap(path[:, 2])
        return path


def lane_piece(step: Step) -> Floats:
    """Middle of the right-hand lane through a tile (n, 3): x, y, heading; the exit excluded."""
    (column, row), entry, leave = step
    middle = (np.array([column, row]) + 0.5) * TILE
    forward, right = np.array(entry, float), np.array([entry[1], -entry[0]], float)
    heading = float(np.arctan2(entry[1], entry[0]))
    start = middle - forward * TILE / 2 + right * LANE_OFFSET
    if leave == entry:
        count = round(TILE / _PATH_STEP)
        along = np.arange(count)[:, None] * (TILE / count)
        return np.column_stack([start + along * forward, np.full(count, heading)])
    turn = 1.0 if leave == (-entry[1], entry[0]) else -1.0
    radius = TILE / 2 + turn * LANE_OFFSET
    count = max(2, round(radius * np.pi / 2 / _PATH_STEP))
    angle = np.arange(count) / count * np.pi / 2
    centre = start - turn * right * radius
    offset = np.cos(angle)[:, None] * turn * right + np.sin(angle)[:, None] * forward
    return np.column_stack([centre + radius * offset, heading + turn * angle])


@lru_cache(maxsize=4)
def road_map(layout: int | tuple[str, ...]) -> RoadMap:
    """The town of a layout: an index into `LAYOUTS`, or the lines of another one."""
    lines = layout if isinstance(layout, tuple) else LAYOUTS[layout % len(LAYOUTS)]
    rows, columns = len(lines), len(lines[0])
    tiles = {
        (column, rows - 1 - index): CONNECTIONS[character]
        for index, line in enumerate(lines)
        for column, character in enumerate(line)
        if CONNECTIONS[character]
    }
    edge = round(TILE * PIXELS_PER_METRE)
    coverage = np.zeros((rows * edge, columns * edge, 4), dtype=np.uint8)
    for (column, row), connections in tiles.items():
        place = np.s_[row * edge : (row + 1) * edge, column * edge : (column + 1) * edge]
        coverage[place] = _painted_tile(connections, edge)
    return RoadMap(columns, rows, tiles, coverage)


def map_pixels(points: Floats) -> NDArray[np.float32]:
    """Map pixels x, y (n, 2) of points in metres; pixel 0 is centred half a pixel from 0."""
    scale = round(TILE * PIXELS_PER_METRE) / TILE
    return (points * scale - 0.5).astype(np.float32)


class _TilePainter:
    """Draws shapes in metres from the middle of a tile into shares per colour."""

    def __init__(self, edge: int) -> None:
        self.pixels = edge * _SUPERSAMPLING
        self.planes = np.zeros((self.pixels, self.pixels, 4), dtype=np.uint8)
        self.planes[..., 3] = 255

    def polygon(self, colour: int, corners: Floats) -> None:
        pixels = (corners / TILE + 0.5) * self.pixels - 0.5
        plane = np.ascontiguousarray(self.planes[..., colour])
        cv2.fillPoly(plane, [np.rint(pixels * 16).astype(np.int32)], 255, shift=4)
        self.planes[..., colour] = plane

    def strip(self, colour: int, line: Floats, width: float) -> None:
        """A strip of some width along the points (n, 2) of a line."""
        along = np.gradient(line, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        side = np.stack([-along[:, 1], along[:, 0]], axis=1) * width / 2
        self.polygon(colour, np.concatenate([line + side, (line - side)[::-1]]))

    def dashes(self, line: Floats, length: float) -> None:
        count = round(length / (_DASH + _GAP))
        position = np.linspace(0, 1, len(line))
        for index in range(count):
            at = (index + np.linspace(0, _DASH / (_DASH + _GAP), 9)) / count
            dash = [np.interp(at, position, line[:, axis]) for axis in (0, 1)]
            self.strip(1, np.stack(dash, axis=1), YELLOW_WIDTH)

    def shares(self, edge: int) -> Coverage:
        return np.asarray(cv2.resize(self.planes, (edge, edge), interpolation=cv2.INTER_AREA))


def _painted_tile(connections: frozenset[Direction], edge: int) -> Coverage:
    painter = _TilePainter(edge)
    sides = [np.array(side, float) for side in sorted(connections)]
    if len(sides) > 2:
        _paint_intersection(painter, connections)
    elif np.allclose(sides[0], -sides[1]):
        along, across = sides[0], np.array([-sides[0][1], sides[0][0]])
        line = np.linspace(-0.5, 0.5, 64)[:, None] * TILE * along
        painter.dashes(line, TILE)
        for side in (-1, 1):
            painter.strip(0, line + side * WHITE_OFFSET * across, WHITE_WIDTH)
    else:
        corner = (sides[0] + sides[1]) * TILE / 2
        painter.dashes(_arc(corner, sides[0], sides[1], TILE / 2), TILE * np.pi / 4)
        for side in (-1, 1):
            line = _arc(corner, sides[0], sides[1], TILE / 2 + side * WHITE_OFFSET)
            painter.strip(0, line, WHITE_WIDTH)
    return painter.shares(edge)


def _arc(corner: Floats, first: Floats, second: Floats, radius: float) -> Floats:
    """Quarter of a circle around a corner of the tile from one side to the other, (96, 2)."""
    angle = np.linspace(0, np.pi / 2, 96)[:, None]
    return corner - radius * (np.cos(angle) * first + np.sin(angle) * second)


def _paint_intersection(painter: _TilePainter, connections: frozenset[Direction]) -> None:
    for side in (EAST, NORTH, WEST, SOUTH):
        outward = np.array(side, float)
        left = np.array([-side[1], side[0]], float)
        if side in connections:
            edge = (TILE / 2 - RED_WIDTH / 2) * outward
            reach = WHITE_OFFSET - WHITE_WIDTH / 2
            stop = edge + np.linspace(YELLOW_WIDTH / 2, reach, 2)[:, None] * left
            painter.strip(2, stop, RED_WIDTH)
            following = (-side[1], side[0])
            if following in connections:
                corner = (outward + left) * TILE / 2
                line = _arc(corner, outward, left, TILE / 2 - WHITE_OFFSET)
                painter.strip(0, line, WHITE_WIDTH)
        else:
            line = WHITE_OFFSET * outward + np.linspace(-0.5, 0.5, 2)[:, None] * TILE * left
            painter.strip(0, line, WHITE_WIDTH)
