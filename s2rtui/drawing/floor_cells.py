"""Draw floors and outlines of rooms in character cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import Canvas, Theme, legible, luma, mix
from s2rtui.canvas.block_symbols import BlockCells, SymbolSet, cells_of, fit_blocks
from s2rtui.canvas.colour import ANSI_16
from s2rtui.canvas.raster import draw_blocks, draw_braille, draw_shades, segment_dots
from s2rtui.drawing.floor import (
    floor_pixels,
    heat_layer,
    plan_layer,
    plane_frame,
    seen_layer,
    wall_layer,
)
from s2rtui.drawing.heat_colours import heat_glyphs, heat_ramp, heat_strength
from s2rtui.drawing.plane_marks import Floor, Outlines
from s2rtui.drawing.plot import Plot

FLOOR_RAMPS = {True: "  ..::", False: "   ░░"}
WALL_LINES = {True: "_|||_|||_|||_|||", False: "╬║║║═╝╗╣═╚╔╠═╩╦╬"}
"""Walls without block characters, by whether they are ASCII: the character of a cell whose
neighbours above (1), below (2), at the left (4) and at the right (8) are walls, too, at the sum of
these numbers. No other mark of a map has them."""
_FAINT = 0.15
"""Share of the heat's range below which no glyphs are drawn."""


def draw_floor(canvas: Canvas, plot: Plot, floor: Floor) -> None:
    """Floor plan and heat in block characters, or in light and dense glyphs without them.

    Unseen floor is dimmed or left blank.
    """
    if floor.is_plain:
        return
    frame = plane_frame(plot.x, plot.y, canvas.width, canvas.height)
    if canvas.options.supports_shading:
        draw_blocks(canvas, _block_cells(floor, frame, canvas.theme, canvas.options.symbol_set))
    else:
        _draw_glyphs(canvas, floor, frame)
        _draw_walls(canvas, floor, frame)


def draw_outlines(canvas: Canvas, plot: Plot, outlines: Outlines) -> None:
    """Dotted outlines of rooms, except beside walls; in ASCII only their corners."""
    frame = plane_frame(plot.x, plot.y, canvas.width, canvas.height)
    dots = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
    for room in outlines.rooms:
        (x0, y0), (x1, y1) = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]]).tolist()
        corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)]
        if canvas.options.ascii:
            for column, row in corners:
                canvas.put(int(np.floor(column)), int(np.floor(row)), "'", canvas.theme.muted)
            continue
        lines = [(corners[start], corners[end]) for start, end in ((0, 1), (2, 3), (0, 2), (1, 3))]
        dots |= segment_dots(lines, canvas.width, canvas.height, every=3)
    if dots.any():
        dots &= ~np.repeat(np.repeat(_beside_walls(canvas, plot, frame), 4, axis=0), 2, axis=1)
    draw_braille(canvas, dots, canvas.theme.muted)


@cached_by_identity(8)
def _block_cells(floor: Floor, frame: MapFrame, theme: Theme, symbols: SymbolSet) -> BlockCells:
    layer = floor_pixels(floor, frame, theme, (symbols.rows, symbols.columns))
    cells = fit_blocks(layer, symbols, theme.background)
    for array in (cells.char, cells.fg, cells.bg):
        array.setflags(write=False)
    return cells


def _draw_glyphs(canvas: Canvas, floor: Floor, frame: MapFrame) -> None:
    seen = seen_layer(floor, frame)
    hidden = None if seen is None else _paired(seen) < 0.5
    plan = plan_layer(floor, frame)
    if plan is not None:
        plan = _paired(plan)
        bright = luma(plan) if canvas.theme.dark else 1 - luma(plan)
        colours = mix(np.array(canvas.theme.background), np.nan_to_num(plan), 0.6)
        if canvas.options.supports_images:
            colours[:] = ANSI_16[8 if canvas.theme.dark else 7]
        levels = bright if hidden is None else np.where(hidden, np.nan, bright)
        draw_shades(canvas, levels, FLOOR_RAMPS[canvas.options.ascii], colours)
    heat = heat_layer(floor, frame)
    if heat is not None:
        levels = _paired(heat)
        is_signed = floor.heat_is_signed
        shown = heat_strength(levels, is_signed) > _FAINT
        shown = shown if hidden is None else shown & ~hidden
        colours = legible(heat_ramp(is_signed)(levels), canvas.theme)
        ramp = heat_glyphs(canvas.options, is_signed)
        draw_shades(canvas, np.where(shown, levels, np.nan), ramp, colours)


def _paired(pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """Average pairs of rows, (2h, w[, C]) to (h, w[, C]), without NaN."""
    pair = pixels[: pixels.shape[0] // 2 * 2].reshape(-1, 2, *pixels.shape[1:])
    good = np.isfinite(pair)
    count = good.sum(axis=1)
    total = np.where(good, pair, 0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _draw_walls(canvas: Canvas, floor: Floor, frame: MapFrame) -> None:
    """Walls in one colour on the page."""
    char, held = _walls(canvas, floor, frame)
    canvas.char[held] = char[held]
    canvas.fg[held] = canvas.theme.wall


def _beside_walls(canvas: Canvas, plot: Plot, frame: MapFrame) -> Bools:
    """The cells (h, w) that show a wall of the plot's floor, and their neighbours."""
    held = np.zeros((canvas.height + 2, canvas.width + 2), dtype=np.bool_)
    for floor in (mark for mark in plot.marks if isinstance(mark, Floor)):
        held[1:-1, 1:-1] |= _walls(canvas, floor, frame)[1]
    held[:, 1:-1] |= held[:, :-2] | held[:, 2:]
    held[1:-1] |= held[:-2] | held[2:]
    return held[1:-1, 1:-1]


def _walls(canvas: Canvas, floor: Floor, frame: MapFrame) -> tuple[NDArray[np.str_], Bools]:
    """The characters (h, w) of walls and the cells that have one.

    Block characters, or lines where colours cannot tell them from heat.
    """
    options, symbols = canvas.options, canvas.options.symbol_set
    pixels = (symbols.rows, symbols.columns) if options.supports_images else (1, 1)
    parts = wall_layer(floor, frame, pixels)
    if parts is None:
        return canvas.char, np.zeros(canvas.char.shape, dtype=np.bool_)
    walls, seen = parts[0], seen_layer(floor, frame, pixels)
    if seen is not None and not options.supports_shading:
        walls = walls & (seen >= 0.5)
    return cells_of(walls, symbols) if options.supports_images else wall_lines(walls, options.ascii)


def wall_lines(walls: Bools, ascii: bool) -> tuple[NDArray[np.str_], Bools]:
    """The line characters (h, w) of cells with a wall (h, w), each joined to its neighbours.

    Also returns the cells that have one, which are `walls`.
    """
    near = np.pad(walls, 1)
    up, down = near[:-2, 1:-1], near[2:, 1:-1]
    left, right = near[1:-1, :-2], near[1:-1, 2:]
    joints = up + 2 * down + 4 * left + 8 * right
    return np.array(list(WALL_LINES[ascii]))[joints], walls
