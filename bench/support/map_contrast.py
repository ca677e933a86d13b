"""Contrast of a drawn map, measured from its cells after their colours were encoded.

Ratios are those of WCAG 2. Points are placed in every cell of the map, selected ones with random
values in every second cell and unselected ones in the others, so that every ground is measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from s2rstore.records import Bounds
from s2rtui.analysis.floor_walls import WALL, plan_parts
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame, sample
from s2rtui.canvas import Pixels, RenderOptions
from s2rtui.canvas.colour import luminance
from s2rtui.charts.map import MapInput, map_drawing
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.floor import plane_frame
from s2rtui.drawing.plane_marks import Floor
from s2rtui.export.screenshot import HEIGHT, WIDTH, rasterize
from s2rtui.terminal.strips import to_strips

Ratios = NDArray[np.float64]
_TOLERANCE = 12
"""Colour tolerance of the map in the application (`s2rtui.app.app`)."""
_LEAST_WALL = 0.1
"""Share of a cell that a wall covers at least to be measured."""


@dataclass(frozen=True, slots=True, eq=False)
class MapContrasts:
    """Ratios of walls to the floor beside them, and of points to their ground, one per cell."""

    walls: Ratios
    selected: Ratios
    unselected: Ratios


def measure(
    plan: Pixels,
    bounds: Bounds,
    options: RenderOptions,
    size: tuple[int, int] = (70, 38),
    heat: NDArray[np.float64] | None = None,
) -> MapContrasts:
    """The contrasts of a floor plan (H, W, 3) drawn in `size` (columns, rows).

    `heat` (rows, columns) covers the bounds.
    """
    for_layout = _points(plan, bounds, np.full((2, 2), np.nan), heat)
    place = drawing_layout(map_drawing(for_layout), size, options).plots[0]
    frame = plane_frame(place.plot.x, place.plot.y, place.width, place.rows)
    centres = _cell_centres(frame, bounds)
    points = _points(plan, bounds, centres, heat)
    empty = _points(plan, bounds, np.full_like(centres, np.nan), heat)
    box = (slice(0, place.rows), slice(place.left, place.left + place.width))
    walls = _wall_contrasts(_pixels(empty, size, options), plan, bounds, frame, place.left)
    before, drawn = (draw_cells(map_drawing(view), size, options) for view in (empty, points))
    cells = _pixels(points, size, options).reshape(size[1], HEIGHT, size[0], WIDTH)
    cells = cells.transpose(0, 2, 1, 3).reshape(size[1], size[0], -1)
    changed = np.zeros(drawn.char.shape, dtype=np.bool_)
    changed[box] = (drawn.char != before.char)[box]
    grey = (drawn.fg == np.array(options.theme.unselected)).all(axis=-1)
    ground = cells[..., 0]
    ratios = _ratio(cells, ground[..., None]).max(axis=-1)
    return MapContrasts(walls, ratios[changed & ~grey], ratios[changed & grey])


def _points(
    plan: Pixels, bounds: Bounds, truth: NDArray[np.float64], heat: NDArray[np.float64] | None
) -> MapInput:
    """A map with points at `truth` (N, 2), every second one selected."""
    random, count = np.random.default_rng(1), len(truth)
    x, y = truth.T.copy()
    return MapInput(
        *((x, y) for _ in range(5)), random.uniform(0, 1, count), np.arange(count) % 2 == 0,
        np.ones(count, dtype=np.bool_), Floor(bounds, plan, heat),
    )  # fmt: skip


def _cell_centres(frame: MapFrame, bounds: Bounds) -> NDArray[np.float64]:
    """(N, 2) middles of the cells inside the bounds."""
    columns, rows = np.meshgrid(np.arange(frame.width), np.arange(frame.height // 2))
    x = frame.x0 + (columns.ravel() + 0.5) * frame.pitch
    y = frame.y0 + (2 * rows.ravel() + 1) * frame.pitch
    inside = (x > bounds.x0) & (x < bounds.x1) & (y > bounds.y0) & (y < bounds.y1)
    return np.stack([x, y], axis=1)[inside]


def _pixels(data: MapInput, size: tuple[int, int], options: RenderOptions) -> Ratios:
    """Luminances of the pixels of a drawn map, HEIGHT x WIDTH per cell.

    The first pixel of a cell shows the ground of its glyph.
    """
    canvas = draw_cells(map_drawing(data), size, options)
    strips = to_strips(canvas, options.mode, options.ascii, _TOLERANCE)
    return np.asarray(luminance(np.asarray(rasterize(strips, options.theme))), dtype=np.float64)


def _wall_contrasts(
    drawn: Ratios, plan: Pixels, bounds: Bounds, frame: MapFrame, left: int
) -> Ratios:
    """The contrast of each cell with a wall to the median floor in the 5 x 5 cells around it.

    A wall may be drawn up to a quarter of a cell beside its place: of the pixels so far away, the
    one that contrasts most counts, in the median over the wall's pixels of the cell.
    """
    wall, floor = _truth(plan, bounds, frame)
    rows, columns = wall.shape[:2]
    drawn = drawn[: rows * HEIGHT, left * WIDTH : (left + columns) * WIDTH]
    reach = (HEIGHT + 1, WIDTH + 1)
    image, high, low = (
        part.reshape(rows, HEIGHT, columns, WIDTH).transpose(0, 2, 1, 3).reshape(rows, columns, -1)
        for part in (drawn, maximum_filter(drawn, reach), minimum_filter(drawn, reach))
    )
    ratios = []
    for row, column in np.argwhere(wall.mean(axis=-1) >= _LEAST_WALL).tolist():
        near = (slice(max(0, row - 2), row + 3), slice(max(0, column - 2), column + 3))
        if floor[near].any():
            around = np.median(image[near][floor[near]])
            held = wall[row, column]
            most = [_ratio(part[row, column][held], around) for part in (high, low)]
            ratios.append(float(np.median(np.maximum(*most))))
    return np.array(ratios)


@cached_by_identity(4)
def _truth(
    plan: Pixels, bounds: Bounds, frame: MapFrame
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which pixels of each cell (rows, columns, HEIGHT * WIDTH) are wall in the plan, and which
    cells are floor alone."""
    fine = (HEIGHT, WIDTH)
    parts = np.nan_to_num(sample(plan_parts(plan, bounds.width), bounds, frame, True, fine))
    inside = np.isfinite(sample(plan[..., 0], bounds, frame, True, fine))
    rows, columns = frame.height // 2, frame.width
    wall, floor = (
        mask.reshape(rows, HEIGHT, columns, WIDTH).transpose(0, 2, 1, 3).reshape(rows, columns, -1)
        for mask in (parts[..., WALL] >= 0.5, (parts.max(axis=-1) == 0) & inside)
    )
    return wall, floor.all(axis=-1)


def _ratio(first: Ratios, second: Ratios) -> Ratios:
    high, low = np.maximum(first, second), np.minimum(first, second)
    return np.asarray((high + 0.05) / (low + 0.05))
