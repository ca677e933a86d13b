"""Draws the overview's lines: every instance as a thread from run to run, dense ones brighter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.colour import Pixels, Rgb, mix
from s2rtui.canvas.colour_mode import ColourMode
from s2rtui.canvas.raster import braille, dot_grid, segment_dots
from s2rtui.canvas.render_options import RenderOptions
from s2rtui.charts.overview.layout import OverviewLayout, axis_share
from s2rtui.charts.overview.lines import Density, levels, line_density
from s2rtui.charts.shared.axis_scale import finite
from s2rtui.charts.shared.inputs import Interval, OverviewLines

LIT_RAMP = "'+*#"
OTHER_RAMP = "."
DITHER = np.array([[0, 4], [6, 2], [1, 5], [7, 3]]) / 8
"""Thresholds of the dots of a cell: the share of dots that stay tells how dense it is."""


def draw_threads(
    canvas: Canvas,
    lines: OverviewLines,
    axis: Interval,
    layout: OverviewLayout,
    look: RenderOptions,
) -> None:
    """All lines behind the marks, then the cursor's own."""
    density = line_density(lines, axis, layout)
    chart = Canvas(layout.chart_width, layout.height, look.theme)
    chart.bg[:] = canvas.bg[_place(layout)]
    colour = look.theme.sim if lines.side == "sim" else look.theme.real
    _layer(chart, density.others, look.theme.unselected, OTHER_RAMP, look, faint=True)
    _layer(chart, density.lit, colour, LIT_RAMP, look, faint=False)
    if layout.step > 1 and lines.cursor is not None:
        _own(chart, lines, axis, layout, look)
    canvas.paste(chart, layout.chart, layout.top)


def _place(layout: OverviewLayout) -> tuple[slice, slice]:
    rows = slice(layout.top, layout.top + layout.height)
    return rows, slice(layout.chart, layout.chart + layout.chart_width)


def _layer(
    canvas: Canvas, density: Density, colour: Rgb, ramp: str, look: RenderOptions, faint: bool
) -> None:
    """Dots where lines are; brighter where they are dense, fewer where they are not."""
    peak = float(density.max(initial=0.0))
    if peak <= 0:
        return
    shares = levels(density, peak)
    cells = shares.reshape(canvas.height, 4, canvas.width, 2)
    per_cell = cells.max(axis=(1, 3))
    if look.ascii:
        steps = np.minimum(np.ceil(per_cell * len(ramp)), len(ramp)).astype(np.intp)
        rows, columns = np.nonzero(steps)
        canvas.char[rows, columns] = np.array(list(ramp))[steps[rows, columns] - 1]
        canvas.fg[rows, columns] = colour
        return
    strength = np.clip(np.log10(peak) - 1.5, 0, 1)
    dither = np.tile(DITHER, (canvas.height, canvas.width))
    dots = (density > 0) & (shares > 0.7 * strength * dither)
    if faint and look.mode is ColourMode.NONE:
        dots &= (np.indices(dots.shape).sum(axis=0) % 2).astype(np.bool_)
    braille(canvas, 0, 0, dots, _shades(per_cell, colour, faint, look))


def _shades(shares: Density, colour: Rgb, faint: bool, look: RenderOptions) -> Pixels:
    """A colour per cell, from near the background to the colour itself."""
    low, high = (0.35, 0.75) if faint else (0.6, 1.0)
    share = low + (high - low) * shares
    return mix(np.array(look.theme.background), np.array(colour), share)


def _own(
    canvas: Canvas,
    lines: OverviewLines,
    axis: Interval,
    layout: OverviewLayout,
    look: RenderOptions,
) -> None:
    """The cursor's line over all others, broken where it has no accuracy."""
    grid = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
    places = [
        _cell(value, axis, layout, index)
        for index, value in enumerate(own_accuracies(lines)[layout.first :][: layout.shown])
    ]
    for start, stop in pairwise(places):
        if start is not None and stop is not None:
            columns, rows = segment_dots(*start, *stop)
            grid |= dot_grid(columns, rows, canvas.width, canvas.height)
    if not look.ascii:
        braille(canvas, 0, 0, grid, np.array(look.theme.cursor, dtype=np.uint8))
        return
    held = grid.reshape(canvas.height, 4, canvas.width, 2).any(axis=(1, 3))
    for row, column in np.argwhere(held).tolist():
        canvas.put(column, row, look.glyphs.cursor, look.theme.cursor, bold=True)


def _cell(
    value: float | None, axis: Interval, layout: OverviewLayout, index: int
) -> tuple[float, float] | None:
    if value is None:
        return None
    share = min(1.0, max(0.0, axis_share(value, axis)))
    return 0.5 + share * (layout.chart_width - 1), index * layout.step + 0.5


def own_accuracies(lines: OverviewLines) -> list[float | None]:
    """The cursor's accuracy in every run, None where there is none."""
    if lines.cursor is None:
        return [None] * len(lines.values)
    iid = lines.cursor
    return [
        finite(float(column[iid])) if 0 <= iid < len(column) else None for column in lines.values
    ]
