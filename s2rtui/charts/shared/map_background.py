"""The ground of a map: floor plan, heat and clip, as a picture or as glyphs, and the rooms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from s2rstore.records import Room
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.colour import legible, luma, mix, turbo
from s2rtui.canvas.raster import braille, dot_grid, half_blocks, segment_dots, shade
from s2rtui.canvas.raster import ground as prepare
from s2rtui.canvas.render_options import RenderOptions
from s2rtui.charts.shared.inputs import Ground
from s2rtui.charts.shared.map_layers import floor_layer, ground_layer, heat_layer, seen_layer

FLOOR_RAMPS = {True: "  ..::", False: "   ░░"}
HEAT_RAMPS = {True: "-=+*#%", False: "▒▓█"}
FAINT = 0.15
"""Share of the heat's range under which glyphs leave it out."""


def draw_ground(canvas: Canvas, ground: Ground, frame: MapFrame, look: RenderOptions) -> None:
    """Half blocks; where those lack light glyphs for the floor and dense ones for heat.

    What was not seen is dimmed, or has no glyphs. Rooms have dotted outlines.
    """
    if ground.floor_plan is not None or ground.heat is not None:
        if look.fine:
            half_blocks(canvas, 0, 0, ground_layer(ground, frame, look.theme))
        else:
            _glyphs(canvas, ground, frame, look)
    _outlines(canvas, ground.rooms, frame, look)


def _glyphs(canvas: Canvas, ground: Ground, frame: MapFrame, look: RenderOptions) -> None:
    seen = seen_layer(ground, frame)
    hidden = None if seen is None else _paired(seen) < 0.5
    floor = floor_layer(ground, frame)
    if floor is not None:
        floor = _paired(floor)
        bright = luma(floor) if look.theme.dark else 1 - luma(floor)
        colours = mix(np.array(look.theme.background), np.nan_to_num(floor), 0.6)
        levels = bright if hidden is None else np.where(hidden, np.nan, bright)
        shade(canvas, 0, 0, levels, FLOOR_RAMPS[look.ascii], colours)
    heat = heat_layer(ground, frame)
    if heat is not None:
        levels = _paired(heat)
        shown = levels > FAINT if hidden is None else (levels > FAINT) & ~hidden
        colours = legible(turbo(levels), look.theme)
        shade(canvas, 0, 0, np.where(shown, levels, np.nan), HEAT_RAMPS[look.ascii], colours)


def _paired(pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """(2h, w[, C]) to (h, w[, C]): the mean of two rows, NaN left out."""
    pair = pixels[: pixels.shape[0] // 2 * 2].reshape(-1, 2, *pixels.shape[1:])
    good = np.isfinite(pair)
    count = good.sum(axis=1)
    total = np.where(good, pair, 0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _outlines(canvas: Canvas, rooms: Sequence[Room], frame: MapFrame, look: RenderOptions) -> None:
    """Every third dot along the edges; in ASCII the corners alone."""
    dots = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
    for room in rooms:
        (x0, y0), (x1, y1) = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]]).tolist()
        for (u0, v0), (u1, v1) in (
            ((x0, y0), (x1, y0)),
            ((x0, y1), (x1, y1)),
            ((x0, y0), (x0, y1)),
            ((x1, y0), (x1, y1)),
        ):
            if look.ascii:
                canvas.put(int(np.floor(u0)), int(np.floor(v0)), "'", look.theme.muted)
                canvas.put(int(np.floor(u1)), int(np.floor(v1)), "'", look.theme.muted)
                continue
            columns, rows = segment_dots(u0, v0, u1, v1)
            dots |= dot_grid(columns[::3], rows[::3], canvas.width, canvas.height)
    braille(canvas, 0, 0, dots, np.array(look.theme.muted, dtype=np.uint8))


def draw_names(canvas: Canvas, rooms: Sequence[Room], frame: MapFrame, look: RenderOptions) -> None:
    """Each name once, in the middle of its room, where it fits."""
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
            prepare(canvas, columns, np.full_like(columns, row))
            canvas.text(column, row, name, look.theme.muted)
