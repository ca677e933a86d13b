"""Draw a `Drawing` in character cells."""

from __future__ import annotations

import textwrap

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, RenderOptions, Rgb, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.raster import dot_grid, draw_braille
from s2rtui.drawing.plot import ROLES, Dots, Drawing, Ink, Line, Plot, Rule, TableSpec
from s2rtui.drawing.scale import Scale

_FEWEST_ROWS = 5
"""Rows of a plot, without its axis, from which on it is drawn."""
_GAP = 2
"""Blank columns between the columns of a table."""
_DASH = 4
"""Dots of a dash and its gap."""


def draw_cells(drawing: Drawing, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """Draw the plot, the table and the notes in `size` (columns, rows).

    The plot has the rows that the table and the notes leave, but at least `_FEWEST_ROWS` where the
    canvas is twice as high; then the last rows of the table are left out, and a line says so.
    """
    canvas = Canvas(*size, options)
    notes = [line for note in drawing.notes for line in textwrap.wrap(note, canvas.width)]
    notes = notes[: canvas.height]
    wanted = 0 if drawing.table is None else len(drawing.table.rows) + 1
    top = 0
    if drawing.plot is not None:
        extra = 2 + bool(drawing.plot.legend)
        rows = canvas.height - wanted - len(notes) - extra
        if canvas.height >= 2 * (_FEWEST_ROWS + extra):
            rows = max(rows, _FEWEST_ROWS)
        if rows >= _FEWEST_ROWS:
            _draw_plot(canvas, drawing.plot, rows)
            top = rows + extra
    if drawing.table is not None:
        top = _draw_table(canvas, drawing.table, top, canvas.height - len(notes) - top)
    for row, note in enumerate(notes, start=top):
        canvas.text(0, row, note, canvas.theme.muted)
    return canvas


def _style(canvas: Canvas, ink: Ink) -> tuple[str, Rgb]:
    """The glyph and the colour of an ink."""
    glyph = getattr(canvas.glyphs, ink) if ink in ROLES else canvas.glyphs.unselected
    return glyph, getattr(canvas.theme, ink)


def _draw_plot(canvas: Canvas, plot: Plot, rows: int) -> None:
    """The legend, `rows` rows of marks with the labels of y at the left, and the axis of x."""
    top, theme = int(bool(plot.legend)), canvas.theme
    labels = list(plot.y.labels(rows - 1, max(3, rows // 3), lambda text: 0.0, 1.0))
    left = max((cell_len(text) for *_, text in labels), default=0) + 1
    width = max(2, canvas.width - left)
    for _, tick, text in labels:
        canvas.text(left - 1, top + rows - 1 - round(tick), text, theme.muted, align="right")
    column = left
    for line in plot.legend:
        glyph, colour = _style(canvas, line.ink)
        if line.dashed or line.ink not in ROLES:
            glyph = "- -" if line.dashed else canvas.glyphs.horizontal
        column = canvas.text(column, 0, f"{glyph} {line.name}", colour) + _GAP
    if plot.legend:
        name = plot.y.name(canvas.width - column, cell_len)
        canvas.text(canvas.width, 0, name, theme.muted, align="right")
    part = Canvas(width, rows, canvas.options)
    for mark in plot.marks:
        if isinstance(mark, Line):
            _draw_line(part, plot, mark)
        elif isinstance(mark, Dots):
            _draw_dots(part, plot, mark)
        else:
            _draw_rule(part, plot, mark)
    canvas.paste(part, left, top)
    _draw_axis(canvas, plot.x, left, top + rows)


def _draw_axis(canvas: Canvas, scale: Scale, left: int, row: int) -> None:
    """Labels and name; round numbers leave room for the name, and fixed labels come before it."""
    width, muted = canvas.width - left, canvas.theme.muted
    name = scale.name(width / 2, cell_len)
    stop = width if scale.fixed is not None else width - cell_len(name) - 1
    end = 0
    for start, _, text in scale.labels(width, max(2, width // 8), cell_len, 1.0):
        if int(start) + cell_len(text) <= stop:
            end = canvas.text(left + int(start), row, text, muted)
    name = scale.name(canvas.width - end - 1, cell_len)
    canvas.text(canvas.width, row, name, muted, align="right")


def _rows(plot: Plot, y: NDArray[np.float64], height: int) -> NDArray[np.float64]:
    """Rows of values of y: 0 is the first one, `height` - 1 the last one."""
    return np.asarray((1 - plot.y.fraction(y)) * (height - 1))


def _columns(plot: Plot, x: NDArray[np.float64], width: int) -> NDArray[np.intp]:
    """Columns of values of x, the end of the axis in the last one; -1 outside of the axis."""
    places = plot.x.fraction(x)
    inside = (places >= 0) & (places <= 1)
    columns = np.minimum(np.floor(np.where(inside, places, 0) * width + 1e-9), width - 1)
    return np.asarray(np.where(inside, columns, -1), dtype=np.intp)


def _draw_line(canvas: Canvas, plot: Plot, line: Line) -> None:
    """Braille dots; in ASCII a glyph in every second column."""
    if not line.x.size:
        return
    width, height = canvas.width, canvas.height
    fractions = (np.arange(2 * width) + 0.5) / (2 * width)
    values = np.interp(plot.x.value(fractions), line.x, line.y, left=np.nan, right=np.nan)
    heights = _rows(plot, values, height)
    glyph, colour = _style(canvas, line.ink)
    if canvas.options.ascii:
        for column in range(0, width, 4 if line.dashed else 2):
            if np.isfinite(heights[2 * column]):
                canvas.put(column, round(heights[2 * column]), glyph, colour)
        return
    steps = np.linspace(0, 1, 4 * height)[:, None]
    joined = heights[:-1] + (heights[1:] - heights[:-1]) * steps + 0.5
    across = np.broadcast_to(fractions[1:] * width, joined.shape)
    drawn = np.isfinite(joined)
    if line.dashed:
        drawn &= np.arange(joined.shape[1]) % _DASH < _DASH // 2
    draw_braille(canvas, dot_grid(across[drawn], joined[drawn], width, height), colour)


def _draw_dots(canvas: Canvas, plot: Plot, dots: Dots) -> None:
    glyph, colour = _style(canvas, dots.ink)
    columns = _columns(plot, dots.x, canvas.width)
    for column, row in zip(columns, _rows(plot, dots.y, canvas.height), strict=True):
        if np.isfinite(row):
            canvas.put(int(column), round(row), glyph, colour, bold=True)


def _draw_rule(canvas: Canvas, plot: Plot, rule: Rule) -> None:
    colour, glyphs = getattr(canvas.theme, rule.ink), canvas.glyphs
    at = np.array([rule.at])
    if rule.axis == "x":
        column = int(_columns(plot, at, canvas.width)[0])
        canvas.vline(column, 0, canvas.height - 1, glyphs.vertical, colour)
    else:
        row = round(float(_rows(plot, at, canvas.height)[0]))
        canvas.hline(0, canvas.width - 1, row, glyphs.horizontal, colour)


def _draw_table(canvas: Canvas, table: TableSpec, top: int, room: int) -> int:
    """Draw what fits into `room` rows from `top` on; returns the row after it.

    Details of cells are drawn where those of all rows fit.
    """
    if room < 1:
        return top
    whole = [[cell.whole for cell in row] for row in table.rows]
    plain = [[cell.text for cell in row] for row in table.rows]
    names = [[f"{_prefix(canvas, column.ink)}{column.name}" for column in table.columns]]
    widths = _widths(names + whole)
    is_wide = sum(widths) + _GAP * (len(widths) - 1) <= canvas.width
    widths = widths if is_wide else _widths(names + plain)
    starts = [sum(widths[:place]) + _GAP * place for place in range(len(widths))]
    theme, ellipsis = canvas.theme, canvas.glyphs.ellipsis
    for start, name, column in zip(starts, names[0], table.columns, strict=True):
        canvas.text(start, top, name, getattr(theme, column.ink))
    shown = len(table.rows) if len(table.rows) < room else max(0, room - 2)
    for row, cells in enumerate(table.rows[:shown], start=top + 1):
        for place, (start, cell) in enumerate(zip(starts, cells, strict=True)):
            text = fit_text(cell.text, canvas.width - start, ellipsis)
            end = canvas.text(start, row, text, theme.text if place else theme.muted)
            if is_wide and cell.detail:
                canvas.text(end + 1, row, f"({cell.detail})", theme.muted)
    hidden = len(table.rows) - shown
    if hidden and room > 1:
        canvas.text(0, top + 1 + shown, f"{hidden} more rows: enlarge the view", theme.muted)
    return top + 1 + shown + bool(hidden)


def _prefix(canvas: Canvas, ink: Ink) -> str:
    return f"{getattr(canvas.glyphs, ink)} " if ink in ROLES else ""


def _widths(rows: list[list[str]]) -> list[int]:
    return [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
