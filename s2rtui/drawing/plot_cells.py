"""Draw the marks of a plot in character cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import Canvas, Rgb
from s2rtui.canvas.raster import dot_grid, draw_braille
from s2rtui.drawing.arcs_cells import number_cells
from s2rtui.drawing.bars import draw_vertical_bars, put_over_bar
from s2rtui.drawing.image import Image
from s2rtui.drawing.image_cells import draw_image
from s2rtui.drawing.plane_cells import draw_names, draw_plane_mark
from s2rtui.drawing.plane_marks import GROUND
from s2rtui.drawing.plot import ROLES, Bars, Dots, Ink, Line, Plot, Points, Rule
from s2rtui.drawing.points_cells import draw_points
from s2rtui.drawing.scale import Scale, short_number

_ROUNDING = 1e-9
"""Fractions of a scale this far beyond its ends lie at them."""
_DASH = 4
"""Dots of a dash and its gap."""


def draw_marks(canvas: Canvas, plot: Plot) -> NDArray[np.bool_]:
    """Draw the marks of a plot on the whole canvas.

    Returns the cells (h, w) whose characters stay texts over a picture of the marks.
    """
    ground: Canvas | None = None
    for each in plot.marks:
        if ground is None and not isinstance(each, GROUND):
            ground = _copy(canvas)
        if isinstance(each, Bars):
            _draw_bars(canvas, plot, each)
        elif isinstance(each, Line):
            _draw_line(canvas, plot, each)
        elif isinstance(each, Dots):
            _draw_dots(canvas, plot, each)
        elif isinstance(each, Points):
            draw_points(canvas, plot, each)
            _draw_cursor(canvas, plot, each)
        elif isinstance(each, Image):
            draw_image(canvas, each)
        elif isinstance(each, Rule):
            _draw_rule(canvas, plot, each)
        else:
            draw_plane_mark(canvas, plot, each)
    return number_cells(canvas, plot) | draw_names(canvas, plot, ground or canvas)


def _copy(canvas: Canvas) -> Canvas:
    copy = Canvas(canvas.width, canvas.height, canvas.options)
    copy.paste(canvas, 0, 0)
    return copy


def _draw_cursor(canvas: Canvas, plot: Plot, points: Points) -> None:
    if points.cursor is None:
        return
    x, y = float(points.x[points.cursor]), float(points.y[points.cursor])
    places = plot.x.fraction(x), plot.y.fraction(y)
    if all(0 <= place <= 1 for place in places):
        at = column_of(plot.x, x, canvas.width), row_of(plot.y, y, canvas.height)
        canvas.put(*at, *canvas.options.role("cursor"), bold=True)


def style_of(canvas: Canvas, mark: Line | Dots) -> tuple[str, Rgb]:
    """The glyph and the colour of a mark."""
    sign: str | None = mark.sign if isinstance(mark, Dots) else None
    sign = sign or (mark.ink if mark.ink in ROLES else "unselected")
    return getattr(canvas.glyphs, sign), _ink(canvas, mark.ink)


def _ink(canvas: Canvas, ink: Ink) -> Rgb:
    colour: Rgb = getattr(canvas.theme, ink)
    return colour


def column_of(scale: Scale, x: float, width: int) -> int:
    """The column of a value, which may lie outside of the axis; its end is in the last one."""
    place = float(scale.fraction(x)) * width
    return width - 1 if abs(place - width) < 1e-9 else int(np.floor(place + 1e-9))


def row_of(scale: Scale, y: float, height: int) -> int:
    """The row of a value from the top; values beyond the axis are in the first or the last row."""
    place = float(scale.fraction(y)) * height
    return height - 1 - int(np.clip(np.floor(place + 1e-9), 0, height - 1))


def _draw_bars(canvas: Canvas, plot: Plot, bars: Bars) -> None:
    """A bar in each column, that of the interval in which the middle of the column lies."""
    middles = plot.x.value((np.arange(canvas.width) + 0.5) / canvas.width)
    places = np.searchsorted(bars.edges, middles, side="right") - 1
    inside = (places >= 0) & (places < bars.part.size)
    held = np.where(inside, places, 0)
    part, whole = (
        np.where(inside, plot.y.fraction(counts[held]), 0.0) for counts in (bars.part, bars.whole)
    )
    draw_vertical_bars(canvas, (part, whole), _ink(canvas, bars.ink))


def _draw_line(canvas: Canvas, plot: Plot, line: Line) -> None:
    """Braille dots, in ASCII a glyph in every second column; nothing beyond the scale of y."""
    if not line.x.size:
        return
    width, height = canvas.width, canvas.height
    fractions = (np.arange(2 * width) + 0.5) / (2 * width)
    values = np.interp(plot.x.value(fractions), line.x, line.y, left=np.nan, right=np.nan)
    up = plot.y.fraction(values)
    up = np.where((up >= -_ROUNDING) & (up <= 1 + _ROUNDING), up, np.nan)
    heights = np.clip((1 - up) * height, 0, height - 1e-6)
    glyph, colour = style_of(canvas, line)
    if canvas.options.ascii:
        for column in range(0, width, 4 if line.dashed else 2):
            if np.isfinite(heights[2 * column]):
                canvas.put(column, int(heights[2 * column]), glyph, colour)
        return
    steps = np.linspace(0, 1, 4 * height)[:, None]
    joined = heights[:-1] + (heights[1:] - heights[:-1]) * steps
    across = np.broadcast_to(fractions[1:] * width, joined.shape)
    drawn: NDArray[np.bool_] = np.isfinite(joined)
    if line.dashed:
        drawn &= np.arange(joined.shape[1]) % _DASH < _DASH // 2
    draw_braille(canvas, dot_grid(across[drawn], joined[drawn], width, height), colour)


def _draw_dots(canvas: Canvas, plot: Plot, dots: Dots) -> None:
    """Signs with their intervals; an arrow with the number where y is beyond the scale."""
    glyph, colour = style_of(canvas, dots)
    beyond: list[tuple[int, int, float]] = []
    places = plot.x.fraction(dots.x)
    for place, x in enumerate(dots.x.tolist()):
        y = float(dots.y[place])
        if not (np.isfinite(y) and 0 <= places[place] <= 1):
            continue
        column, row = column_of(plot.x, x, canvas.width), row_of(plot.y, y, canvas.height)
        if dots.low is not None and dots.high is not None and dots.shift == 1.0:
            _draw_span(canvas, plot, column, (float(dots.low[place]), float(dots.high[place])),
                       colour)  # fmt: skip
        if plot.y.low <= y <= plot.y.high:
            put_over_bar(canvas, column, row, glyph, colour)
        else:
            canvas.put(column, row, canvas.glyphs.arrows[6 if y > plot.y.high else 2], colour,
                       bold=True)  # fmt: skip
            beyond.append((column, row, y))
    for column, row, y in reversed(beyond):
        _write_beside(canvas, column, row, short_number(y), colour)


def _draw_span(
    canvas: Canvas, plot: Plot, column: int, bounds: tuple[float, float], colour: Rgb
) -> None:
    """A vertical line between two values; an arrow at an end beyond the scale."""
    if not np.isfinite(bounds).all():
        return
    low, high = (row_of(plot.y, end, canvas.height) for end in bounds)
    canvas.vline(column, high, low, canvas.glyphs.vertical, colour)
    for row, is_beyond, arrow in (
        (high, bounds[1] > plot.y.high, 6), (low, bounds[0] < plot.y.low, 2)
    ):  # fmt: skip
        if is_beyond:
            canvas.put(column, row, canvas.glyphs.arrows[arrow], colour, bold=True)


def _write_beside(canvas: Canvas, column: int, row: int, text: str, colour: Rgb) -> None:
    """Write a text beside a cell where the cells are free."""
    for start in (column + 1, column - len(text)):
        around = canvas.char[row, max(0, start) : start + len(text)]
        if start >= 0 and start + len(text) <= canvas.width and (around == " ").all():
            canvas.text(start, row, text, colour)
            return


def _draw_rule(canvas: Canvas, plot: Plot, rule: Rule) -> None:
    """A line across the plot, over bars; beyond the end of the axis it is at that end."""
    colour, glyphs = _ink(canvas, rule.ink), canvas.glyphs
    if rule.axis == "x":
        column = int(np.clip(column_of(plot.x, rule.at, canvas.width), 0, canvas.width - 1))
        for row in range(canvas.height):
            glyph = glyphs.baseline if rule.dashed else glyphs.vertical
            put_over_bar(canvas, column, row, glyph, colour, bold=rule.dashed)
    else:
        row = row_of(plot.y, rule.at, canvas.height)
        canvas.hline(0, canvas.width - 1, row, glyphs.horizontal, colour)
