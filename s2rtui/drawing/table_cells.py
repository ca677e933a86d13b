"""Draw a table in character cells, with the lines between its rows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from rich.cells import cell_len

from s2rtui.canvas import Canvas, ColourMode, PlotArea, mix
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.raster import draw_braille
from s2rtui.drawing.bars import draw_horizontal_bars, put_over_bar
from s2rtui.drawing.legend import point_colours
from s2rtui.drawing.plot import ROLES
from s2rtui.drawing.row_lines import Density, LineLayer, RowLines, layer_dots, levels
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Bar, Cell, Column, Dot, Row, Span, StripMark, TableSpec, Text
from s2rtui.drawing.table_layout import TableLayout, TableLine, table_layout

_TICKS = 10
"""Columns of a strip for each tick of its axis."""
PALE = 0.5
"""Strength of the paler ink."""
_RAMP, _GREY = "'+*#", "."
"""Glyphs of the selected, by density, and of the others."""


def draw_table(canvas: Canvas, table: TableSpec, top: int, room: int) -> int:
    """Draw what fits into `room` rows from row `top` on; returns the row after it."""
    if room < 1 or not table.rows:
        return top
    layout = table_layout(table, canvas.width, room)
    part = Canvas(canvas.width, layout.end, canvas.options)
    if layout.top:
        _draw_head(part, table, layout)
    for y, line in enumerate(layout.lines, start=layout.top):
        if _is_held(table, line):
            part.fill(0, y, canvas.width, 1, canvas.theme.highlight)
        for place, scale, start, length in layout.strips(table) if line.part else ():
            for rule in table.columns[place].rules:
                x = _column(scale, rule.at, start, length)
                part.put(x, y, part.glyphs.baseline, getattr(part.theme, rule.ink))
    if table.lines is not None:
        draw_row_lines(part, table, table.lines, layout)
    for y, line in enumerate(layout.lines, start=layout.top):
        _draw_line(part, table, layout, line, y)
    if layout.axis is not None:
        for _, scale, start, length in layout.strips(table):
            if scale.names:
                draw_axis(part, scale, start, layout.axis, length, length // _TICKS)
    canvas.paste(part, 0, top)
    return top + layout.end


def _is_held(table: TableSpec, line: TableLine) -> bool:
    """Whether a line is highlighted; only the first one of a row from which lines go on."""
    low, high = table.brushed or (-1, -2)
    is_chosen = (line.row == table.chosen and table.column is None) or low <= line.row <= high
    return is_chosen and not (table.lines and line.part)


def table_panels(table: TableSpec, top: int, width: int, room: int) -> tuple[PlotArea, ...]:
    """The panels of a table that is drawn from row `top` on; y is the index of a row."""
    if room < 1 or not table.rows:
        return ()
    layout = table_layout(table, width, room)
    rows, first = [line.row for line in layout.lines], top + layout.top

    def to_data(column: float, row: float) -> tuple[float, float]:
        at = min(max(math.floor(row) - first, 0), len(rows) - 1)
        return column, float(rows[at])

    def to_cells(x: float, y: float) -> tuple[float, float]:
        row = round(y)
        at = rows.index(row) if row in rows else row - layout.first
        return x, first + at + 0.5

    def panel(name: str, x: int, wide: int) -> PlotArea:
        return PlotArea(name, "steps", x, first, wide, len(rows), to_data, to_cells)

    if table.panel:
        return (panel(table.panel, 0, max(1, width)),)
    if table.rows[0].name:
        ranges = _ranges(table, layout, first)
        return tuple(part for part in ranges if part.x + part.width <= max(1, width))
    shown = zip(layout.columns, layout.starts, layout.widths, strict=True)
    return tuple(
        panel(table.columns[place].panel, start, min(wide, width - start))
        for place, start, wide in shown
        if table.columns[place].panel and start < width
    )


def _ranges(table: TableSpec, layout: TableLayout, top: int) -> Iterator[PlotArea]:
    """Yield a range of the scale for each visible strip of a row that has a name.

    With lines between them, rows reach half-way to their neighbours.
    """
    nearest = [line.row + (2 * line.part > layout.each) for line in layout.lines]
    for row in dict.fromkeys(nearest):
        first, own = nearest.index(row), layout.lines.index(TableLine(row))
        lines = nearest.count(row) if table.lines else 1
        for _, scale, start, length in layout.strips(table):
            at = start, top + (first if table.lines else own), length, lines
            yield _range(table.rows[row].name, scale, at, top + own)


def _range(name: str, scale: Scale, at: tuple[int, int, int, int], own: int) -> PlotArea:
    """A rectangle (x, y, width, height) of cells; y is 0 to 1 in line `own`, that of the row."""
    left, top, width, height = at

    def to_data(column: float, row: float) -> tuple[float, float]:
        return float(scale.value((column - left) / max(1, width))), row - own

    def to_cells(x: float, y: float) -> tuple[float, float]:
        return left + float(scale.fraction(x)) * max(1, width), y + own

    return PlotArea(name, "range", left, top, width, height, to_data, to_cells)


def _draw_head(canvas: Canvas, table: TableSpec, layout: TableLayout) -> None:
    """The names of the columns; that of the first one is the window where some are hidden."""
    theme = canvas.theme
    down, up = ("v", "^") if canvas.options.ascii else ("▼", "▲")
    window = _window(table, layout)
    for place, start, width in zip(layout.columns, layout.starts, layout.widths, strict=True):
        column = table.columns[place]
        name = canvas.options.printable(column.name)
        if place == 0 and window:
            name = next((text for text in window if len(text) <= width), "")
        glyph = f"{getattr(canvas.glyphs, column.ink)} " if column.ink in ROLES else ""
        arrow = (down if table.descending else up) if column.sorts else ""
        ink = theme.text if column.sorts else getattr(theme, column.ink)
        text = fit_text(f"{glyph}{name}{arrow}", width, "" if place else canvas.glyphs.ellipsis)
        at = start + width - cell_len(text) if column.right else start
        canvas.text(at, 0, text, ink, bold=column.sorts)


def _window(table: TableSpec, layout: TableLayout) -> tuple[str, ...]:
    """Texts that tell which columns, or else which rows, are visible; empty where all are."""
    shown, columns = layout.columns[1:], len(table.columns) - 1
    if table.column is not None and 0 < len(shown) < columns:
        window = f"{shown[0]}-{shown[-1]}"
        return f"columns {window}/{columns}", f"cols {window}/{columns}", f"{window}/{columns}"
    if layout.shown == len(table.rows):
        return ()
    window = f"{layout.first + 1}-{layout.first + layout.shown}"
    return f"{window}/{len(table.rows)}", window


def _draw_line(
    canvas: Canvas, table: TableSpec, layout: TableLayout, line: TableLine, y: int
) -> None:
    theme, glyphs, row = canvas.theme, canvas.glyphs, table.rows[line.row]
    held = _is_held(table, line)
    if line.part == 0 and layout.gutter:
        if held:
            canvas.put(0, y, glyphs.pointer, theme.truth, bold=True)
        if row.marked:
            canvas.put(1, y, glyphs.cursor, theme.cursor, bold=True)
    is_last = layout.each > 1 and line.part == layout.each - 1
    for place, scale, start, length in layout.strips(table) if not is_last else ():
        marks = _marks(table.columns[place], row.cells[place], line)
        _draw_strip(canvas, scale, marks, (start, y, length))
    shown = zip(layout.columns, layout.starts, layout.widths, layout.text_widths, strict=True)
    for place, start, width, text in shown:
        column, cell = table.columns[place], row.cells[place]
        is_held = (line.row, place) == (table.chosen, table.column)
        if column.wraps:
            ink = theme.muted if line.is_note else getattr(theme, row.ink)
            canvas.text(start, y, _line_text(canvas, line, width), ink)
        elif line.part == 0 and (is_held or cell.heat is not None):
            _draw_heat(canvas, cell, (start, y, width), is_held)
        elif line.part == 0 and (cell.text or cell.detail):
            room = width if column.scale is None else text
            _draw_text(canvas, row, column, cell, place, (start + width - room, y, room), held)
        elif (
            line.is_note and place == 0 and not any(table.columns[p].wraps for p in layout.columns)
        ):
            canvas.text(start, y, _line_text(canvas, line, canvas.width - start), theme.muted)


def _line_text(canvas: Canvas, line: TableLine, room: int) -> str:
    """The wrapped text of a line in `room` cells; an ellipsis ends one that goes on."""
    text = canvas.options.printable(line.text)
    return f"{fit_text(text, room - 2)} {canvas.glyphs.ellipsis}" if line.is_cut else text


def _draw_heat(canvas: Canvas, cell: Cell, at: tuple[int, int, int], is_held: bool) -> None:
    """A text on a ground of the colour of its value; the pointer stands before a held one."""
    start, y, width = at
    theme, ink = canvas.theme, canvas.theme.text
    if canvas.options.supports_images and cell.heat is not None:
        red, green, blue = point_colours(theme)(cell.heat).tolist()
        canvas.fill(start - 1, y, width + 1, 1, (red, green, blue))
        ink = theme.background
    canvas.text(start + width, y, cell.text, ink, bold=is_held, align="right")
    if is_held:
        canvas.put(start - 1, y, canvas.glyphs.pointer, ink, bold=True)


def _marks(column: Column, cell: Cell, line: TableLine) -> tuple[StripMark, ...]:
    """The marks of a strip in a line, the rules below its dots; further lines have bars alone."""
    if line.part:
        return tuple(mark for mark in cell.strip if isinstance(mark, Bar))
    lower = (mark for mark in cell.strip if isinstance(mark, Bar | Span))
    rules = (Dot(rule.at, rule.ink, "baseline") for rule in column.rules)
    return *lower, *rules, *(mark for mark in cell.strip if isinstance(mark, Dot | Text))


def _draw_text(
    canvas: Canvas, row: Row, column: Column, cell: Cell, place: int, at: tuple[int, int, int],
    held: bool,
) -> None:  # fmt: skip
    (start, y, width), theme, glyphs = at, canvas.theme, canvas.glyphs
    ink = getattr(theme, row.inks.get(place, row.ink))
    detail = f"({cell.detail})" if cell.in_room(width) != cell.text else ""
    room = width - (cell_len(detail) + 1 if detail else 0)
    sign = f"{getattr(glyphs, row.sign)} " if row.sign and place == 0 else ""
    text = canvas.options.printable(sign + cell.text)
    text = fit_text(text, room, glyphs.ellipsis)
    bold = row.bold or (held and not cell.strip)
    if column.right or column.scale is not None:
        whole = cell_len(text) + (cell_len(detail) + 1 if detail else 0)
        start = start + width - whole
    end = canvas.text(start, y, text, ink, bold=bold)
    if detail:
        canvas.text(end + 1, y, detail, theme.muted)


def _draw_strip(
    canvas: Canvas, scale: Scale, marks: tuple[StripMark, ...], at: tuple[int, int, int]
) -> None:
    """The marks of a cell in `width` cells from (x, y); what is beyond the scale is at its end."""
    (left, y, width), theme, glyphs = at, canvas.theme, canvas.glyphs
    low, high = scale.low, scale.high
    has_bars = any(isinstance(mark, Bar) for mark in marks)

    def column(value: float) -> int:
        return _column(scale, value, left, width)

    for mark in marks:
        ink = getattr(theme, mark.ink)
        if isinstance(mark, Bar):
            if low >= 0:
                part, whole = (float(scale.fraction(end)) for end in (mark.value, mark.whole))
                draw_horizontal_bars(canvas, left, y, width, ([part], [whole]), ink)
            elif math.isfinite(mark.value):
                block = "#" if canvas.options.ascii else "█"
                first, last = sorted((column(0.0), column(mark.value)))
                canvas.hline(first, last, y, block, ink)
        elif isinstance(mark, Span):
            if not (math.isfinite(mark.low) and math.isfinite(mark.high)):
                continue
            ends = column(mark.low), column(mark.high)
            line = glyphs.bar if mark.is_thick else glyphs.interval
            if not has_bars:
                canvas.hline(*ends, y, line, ink)
            for x in range(ends[0], min(ends[1] + 1, canvas.width)) if has_bars else ():
                if canvas.char[y, x] not in "█#":
                    canvas.put(x, y, line, ink)
            for x, is_beyond, glyph in zip(ends, (mark.low < low, mark.high > high), "<>",
                                           strict=True):  # fmt: skip
                if is_beyond:
                    canvas.put(x, y, glyph, theme.text, bold=True)
        elif isinstance(mark, Text):
            text = canvas.options.printable(fit_text(f"{mark.text} ", width))
            canvas.text(left, y, text, ink)
        elif math.isfinite(mark.at):
            x, glyph = min(column(mark.at), canvas.width - 1), getattr(glyphs, mark.sign)
            if {str(canvas.char[y, x]), glyph} == {glyphs.sim, glyphs.real}:
                glyph, ink = glyphs.both, theme.text
            put_over_bar(canvas, x, y, glyph, ink)


def _column(scale: Scale, value: float, left: int, width: int) -> int:
    """The column of a value on a strip of `width` cells from column `left` on."""
    return left + min(max(int(float(scale.fraction(value)) * width), 0), width - 1)


def draw_axis(canvas: Canvas, scale: Scale, left: int, y: int, width: int, most: int) -> None:
    """Labels of at most about `most` ticks, and at the right the longest name that fits."""
    muted, end = canvas.theme.muted, 0
    for start, text in _axis_labels(scale, width, max(2, most)):
        end = canvas.text(left + start, y, text, muted) - left
    name = scale.name(width - end - 1, cell_len)
    canvas.text(left + width, y, name, muted, align="right")


def _axis_labels(scale: Scale, width: int, most: int) -> list[tuple[int, str]]:
    """The labels of an axis and the columns at which they begin.

    They leave room for the longest name of the axis beside which two of them fit, if need be of
    twice as many ticks; fixed labels leave none.
    """
    names = [name for name in scale.names if 0 < cell_len(name) <= width / 2]
    stops = [width - cell_len(name) - 1 for name in names if scale.fixed is None] or [width]
    labels: list[tuple[int, str]] = []
    for stop in stops:
        for count in (most, 2 * most):
            found = scale.labels(width, count, cell_len, 1.0)
            labels = [(int(start), text) for start, _, text in found]
            shown = [label for label in labels if label[0] + cell_len(label[1]) <= stop]
            if len(shown) > 1:
                return shown
    return labels[:1]


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
                _draw_layer(part, layer, layer_dots(layer, scale, width, layout.each))
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
