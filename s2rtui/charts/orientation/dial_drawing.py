"""One dial: ring, bars outwards, the cursor's needle and the pending brush."""

from __future__ import annotations

import numpy as np

from s2rtui.canvas.brush import Mark, Panel
from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.colour import Rgb
from s2rtui.canvas.pending_brush import arc_of
from s2rtui.canvas.raster import braille, dot_grid, segment_dots
from s2rtui.canvas.render_options import RenderOptions, heading_arrow
from s2rtui.charts.orientation.dial import Dial, Dots, bar_dots, ring_dots
from s2rtui.charts.shared.bars import Bars

QUADRANTS = np.array(list(" ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"))
QUARTER = np.array([[1, 2], [4, 8]])


def draw_dial(
    canvas: Canvas,
    panel: Panel,
    dial: Dial,
    bars: Bars,
    cursor: float | None,
    mark: Mark | None,
    colour: Rgb,
    look: RenderOptions,
) -> None:
    """Bars of the selected in `colour`, of all valid in grey behind them; `cursor` in degrees."""
    chart = Canvas(panel.width, panel.height, look.theme)
    if mark is not None:
        _ground(chart, dial, mark, look)
    size = (panel.width, panel.height)
    lit, grey = bars
    blocks = bar_dots(dial, *size, lit, fine=2)
    dots = bar_dots(dial, *size, grey)
    if look.ascii:
        _characters(chart, dial, _cells(blocks, 2), _cells(dots, 4), colour, look)
    else:
        _dots_and_blocks(chart, dial, blocks, dots, colour, look)
    _needle(chart, dial, cursor, look)
    canvas.paste(chart, panel.x, panel.y)
    _rim(canvas, panel, cursor, mark, look)


def _cells(dots: Dots, fine: int) -> Dots:
    """(fine h, 2w) to (h, w): cells with any dot."""
    rows, columns = dots.shape
    return np.asarray(dots.reshape(rows // fine, fine, columns // 2, 2).any(axis=(1, 3)))


def _dots_and_blocks(
    chart: Canvas, dial: Dial, lit: Dots, grey: Dots, colour: Rgb, look: RenderOptions
) -> None:
    """The selected as quarters of cells, solid; ring and all others as braille dots."""
    theme = look.theme
    ring = ring_dots(dial, chart.width, chart.height)
    braille(chart, 0, 0, grey | ring, np.array(theme.unselected, dtype=np.uint8))
    parts = lit.reshape(chart.height, 2, chart.width, 2)
    quarters = (parts * QUARTER[None, :, None, :]).sum(axis=(1, 3))
    held = quarters > 0
    chart.char[held] = QUADRANTS[quarters[held]]
    chart.fg[held] = colour


def _characters(
    chart: Canvas, dial: Dial, lit: Dots, grey: Dots, colour: Rgb, look: RenderOptions
) -> None:
    """Cells of ring, grey and selected bars as characters."""
    ring = _cells(ring_dots(dial, chart.width, chart.height), 4)
    for cells, glyph, ink in (
        (ring, "o", look.theme.muted),
        (grey, ".", look.theme.unselected),
        (lit, "#", colour),
    ):
        chart.char[cells] = glyph
        chart.fg[cells] = ink


def _needle(chart: Canvas, dial: Dial, cursor: float | None, look: RenderOptions) -> None:
    """From the centre to the ring, the way the cursor's instance looks."""
    if cursor is None:
        return
    if look.ascii:
        arrow = heading_arrow(np.radians(cursor), dial.y_down, look.glyphs)[0]
        chart.put(int(dial.x), int(dial.y), arrow, look.theme.cursor, bold=True)
        return
    end = dial.to_cells(cursor, 0.0)
    dots = dot_grid(*segment_dots(dial.x, dial.y, *end), chart.width, chart.height)
    braille(chart, 0, 0, dots, np.array(look.theme.cursor, dtype=np.uint8))


def _ground(chart: Canvas, dial: Dial, mark: Mark, look: RenderOptions) -> None:
    """The sector of a pending brush."""
    middle, half = arc_of(mark)
    across = np.arange(chart.width) + 0.5 - dial.x
    down = 2 * (np.arange(chart.height) + 0.5 - dial.y)
    turn = np.degrees(np.arctan2((down if dial.y_down else -down)[:, None], across[None]))
    apart = np.abs((turn - middle + 180) % 360 - 180)
    chart.bg[apart <= half] = look.theme.highlight


def _rim(
    canvas: Canvas, panel: Panel, cursor: float | None, mark: Mark | None, look: RenderOptions
) -> None:
    """The ends of a pending brush and the cursor's heading, at the rim."""
    if mark is not None:
        middle, half = arc_of(mark)
        for degrees in (middle - half, middle + half):
            _at_rim(canvas, panel, degrees, "+", look.theme.truth)
    if cursor is not None:
        _at_rim(canvas, panel, cursor, look.glyphs.cursor, look.theme.cursor)


def _at_rim(canvas: Canvas, panel: Panel, degrees: float, glyph: str, colour: Rgb) -> None:
    column, row = panel.to_cells(degrees, 1.0)
    across = min(max(int(np.floor(column)), panel.x), panel.x + panel.width - 1)
    down = min(max(int(np.floor(row)), panel.y), panel.y + panel.height - 1)
    canvas.put(across, down, glyph, colour, bold=True)
