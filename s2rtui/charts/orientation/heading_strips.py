"""Headings as a strip from -180 to 180 degrees: what a dial becomes where room is short."""

from __future__ import annotations

import numpy as np

from s2rtui.canvas.brush import Mark, Panel
from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.colour import Rgb
from s2rtui.canvas.pending_brush import arc_of
from s2rtui.canvas.render_options import RenderOptions
from s2rtui.charts.shared.bars import Bars, put_over, upright


def draw_strip(
    canvas: Canvas,
    panel: Panel,
    bars: Bars,
    cursor: float | None,
    mark: Mark | None,
    colour: Rgb,
    look: RenderOptions,
) -> None:
    """Upright bars; the cursor (degrees) and the ends of the pending brush on the last row."""
    bottom = panel.y + panel.height - 1
    ends: tuple[float, ...] = ()
    if mark is not None:
        middle, half = arc_of(mark)
        turn = (np.arange(panel.width) + 0.5) / panel.width * 360 - 180
        held = np.abs((turn - middle + 180) % 360 - 180) <= half
        rows, columns = slice(panel.y, bottom + 1), panel.x + np.flatnonzero(held)
        canvas.bg[rows, columns] = look.theme.highlight
        ends = (middle - half, middle + half)
    each = panel.width // len(np.asarray(bars[0]))
    lit, grey = (np.repeat(part, each) for part in bars)
    upright(canvas, panel.x, panel.y, panel.height, (lit, grey), colour, look)
    for degrees in ends:
        canvas.put(_column(panel, degrees), bottom, "+", look.theme.truth, bold=True)
    if cursor is not None:
        at = _column(panel, cursor)
        put_over(canvas, at, bottom, look.glyphs.cursor, look.theme.cursor)


def _column(panel: Panel, degrees: float) -> int:
    return min(int(panel.to_cells(degrees, 0.0)[0]), panel.x + panel.width - 1)


def draw_strip_axis(canvas: Canvas, panel: Panel, scale: str, look: RenderOptions) -> None:
    """Cardinal degrees on the last row, the scale's number at the left."""
    row, theme, free = canvas.height - 1, look.theme, panel.x
    if len(scale) < panel.x:
        canvas.text(0, row, scale, theme.muted)
    for degrees in (-180, -90, 0, 90):
        text, at = str(degrees), _column(panel, degrees)
        start = at if degrees == -180 else at - len(text) // 2
        if start >= free and start + len(text) <= canvas.width:
            free = canvas.text(start, row, text, theme.muted) + 1
