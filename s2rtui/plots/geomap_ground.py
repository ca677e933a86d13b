"""The ground of the geo-map: floor plan and heat, as a picture or as glyphs, and room names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from s2rstore.records import Room
from s2rtui.canvas.colour import legible, luma, mix, turbo
from s2rtui.canvas.grid import Canvas
from s2rtui.canvas.look import Look
from s2rtui.canvas.raster import ground, half_blocks, shade
from s2rtui.plots.frame import MapFrame, sample
from s2rtui.plots.geomap_model import ground_layer, heat_layer
from s2rtui.plots.inputs import GeoMapInput

FLOOR_RAMPS = {True: "  ..::", False: "   ░░"}
HEAT_RAMPS = {True: "-=+*#%", False: "▒▓█"}
FAINT = 0.15
"""Share of the heat's range under which glyphs leave it out."""


def draw_ground(canvas: Canvas, view: GeoMapInput, frame: MapFrame, look: Look) -> None:
    """Half blocks; where those lack light glyphs for the floor and dense ones for heat."""
    if view.floor_plan is None and view.heat is None:
        return
    if look.fine:
        half_blocks(canvas, 0, 0, ground_layer(view, frame, look.theme))
        return
    if view.floor_plan is not None and view.bounds.width > 0 and view.bounds.height > 0:
        floor = _paired(sample(view.floor_plan, view.bounds, frame, top_is_y0=view.y_down))
        bright = luma(floor) if look.theme.dark else 1 - luma(floor)
        colours = mix(np.array(look.theme.background), np.nan_to_num(floor), 0.6)
        shade(canvas, 0, 0, bright, FLOOR_RAMPS[look.ascii], colours)
    heat, _ = heat_layer(view, frame)
    if heat is not None:
        levels = _paired(heat)
        seen = np.where(levels > FAINT, levels, np.nan)
        shade(canvas, 0, 0, seen, HEAT_RAMPS[look.ascii], legible(turbo(levels), look.theme))


def _paired(pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """(2h, w[, C]) to (h, w[, C]): the mean of two rows, NaN left out."""
    pair = pixels[: pixels.shape[0] // 2 * 2].reshape(-1, 2, *pixels.shape[1:])
    good = np.isfinite(pair)
    count = good.sum(axis=1)
    total = np.where(good, pair, 0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def draw_rooms(canvas: Canvas, rooms: Sequence[Room], frame: MapFrame, look: Look) -> None:
    """The name of each room in its middle, where it fits into the room."""
    named: set[str] = set()
    for room in rooms:
        if room.room in named:
            continue
        named.add(room.room)
        name = room.room.encode("ascii", "replace").decode() if look.ascii else room.room
        corners = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]])
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        if cell_len(name) > x1 - x0 or y1 - y0 < 1:
            continue
        row, column = int((y0 + y1) / 2), int((x0 + x1 - cell_len(name)) / 2)
        if 0 <= row < canvas.height and 0 <= column <= canvas.width - cell_len(name):
            columns = np.arange(column, column + cell_len(name))
            ground(canvas, columns, np.full_like(columns, row))
            canvas.text(column, row, name, look.theme.muted)
