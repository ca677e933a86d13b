"""Draw the lines between the rows of a table in character cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from s2rtui.canvas import Canvas, ColourMode, mix
from s2rtui.canvas.raster import draw_braille
from s2rtui.drawing.row_lines import Density, LineLayer, RowLines, levels, line_dots
from s2rtui.drawing.table import TableSpec
from s2rtui.drawing.table_layout import TableLayout

PALE = 0.5
"""Strength of the paler ink."""
_RAMP, _GREY = "'+*#", "."
"""Glyphs of the selected, by density, and of the others."""


def draw_row_lines(canvas: Canvas, table: TableSpec, lines: RowLines, layout: TableLayout) -> None:
    """Draw the lines of the visible rows on their strips; the cursor has none where these are
    bars.
    """
    shown = replace(lines, values=lines.values[layout.first : layout.first + layout.shown])
    for _, scale, left, width in layout.strips(table):
        if left + width > canvas.width:
            continue
        part = Canvas(width, len(layout.lines), canvas.options)
        below = slice(layout.top, layout.top + part.height), slice(left, left + width)
        part.char[:], part.fg[:], part.bg[:] = (
            cells[below] for cells in (canvas.char, canvas.fg, canvas.bg)
        )
        for layer in shown.layers:
            if layer.size and (layout.each > 1 or layer.ink != "cursor"):
                _draw_layer(part, layer, line_dots(layer, scale, width, layout.each))
        canvas.paste(part, left, layout.top)


def _draw_layer(canvas: Canvas, layer: LineLayer, density: Density) -> None:
    """Dots where lines are, the denser the brighter."""
    colour, theme = getattr(canvas.theme, layer.ink), canvas.theme
    if layer.is_pale:
        colour = mix(theme.background, colour, PALE)
    is_grey = layer.ink == "unselected"
    cells = density.reshape(canvas.height, 4, -1).max(axis=1).reshape(canvas.height, -1, 2)
    shares = levels(cells.max(axis=2), float(cells.max()))
    if canvas.options.ascii:
        signs = {"unselected": _GREY, "cursor": canvas.glyphs.cursor}
        ramp = canvas.glyphs.trained if layer.is_pale else signs.get(layer.ink, _RAMP)
        steps = np.minimum(np.ceil(shares * len(ramp)), len(ramp)).astype(np.intp)
        drawn = steps > 0
        canvas.char[drawn] = np.array(list(ramp))[steps[drawn] - 1]
        canvas.fg[drawn] = colour
        return
    dots = density > 0
    if is_grey and canvas.options.mode is ColourMode.NONE:
        dots &= (np.indices(dots.shape).sum(axis=0) % 2).astype(np.bool_)
    low, high = (0.35, 0.75) if is_grey else (0.6, 1.0)
    draw_braille(canvas, dots, mix(theme.background, colour, low + (high - low) * shares))
