"""Draw a `Drawing` in character cells, and its panels, which take the mouse and brushes."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, replace
from functools import partial

from rich.cells import cell_len

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Panel, Point, RenderOptions, Size
from s2rtui.drawing.drawing import Drawing, Note
from s2rtui.drawing.plot import ROLES, Line, Phrase, Plot
from s2rtui.drawing.plot_cells import draw_marks, row_of, style_of
from s2rtui.drawing.table_cells import draw_axis, draw_table, table_panels
from s2rtui.drawing.table_layout import GAP, TableLayout, table_layout, wanted_lines

_FEWEST_ROWS = 5
"""Rows of a single plot above a table, without its axis, from which on it is drawn."""
_FEWEST_STACKED = 3
"""Rows of each of several plots; those of smaller weight are left out where it has fewer."""
_TICKS = 8
"""Columns of a plot for each tick of its axis."""


@dataclass(frozen=True, slots=True, eq=False)
class PlotPlace:
    """Where a plot is: the row of its title, its first row, their number, the row of its axis."""

    plot: Plot
    head: int | None
    top: int
    rows: int
    axis: int | None


@dataclass(frozen=True, slots=True, eq=False)
class DrawingLayout:
    """Where the parts of a drawing are. left, width: first column and width of the plots.

    table: first row of the table and the number of rows that it has. notes: the last lines.
    """

    plots: tuple[PlotPlace, ...]
    left: int
    width: int
    table: tuple[int, int]
    notes: tuple[tuple[Phrase, ...], ...]


def drawing_layout(drawing: Drawing, size: Size) -> DrawingLayout:
    """Lay out a drawing in `size` (columns, rows).

    Plots have the rows that the table and the notes leave, but at least `_FEWEST_ROWS` where the
    canvas is twice as high; then the last rows of the table are left out, and its head says so.
    """
    width, height = max(1, size[0]), max(1, size[1])
    notes = [line for note in drawing.notes for line in note_rows(note, width)]
    plots = [*drawing.plots]
    notes = notes[: height if drawing.table is None and not plots else height // 2]
    wanted = 0 if drawing.table is None else wanted_lines(drawing.table)
    area, top = height - wanted - len(notes), 0
    least = _FEWEST_ROWS if drawing.table is not None or notes else 1
    extra = 1 + any(_has_head(plot) for plot in plots)
    if plots and height >= 2 * (least + extra):
        area = max(area, min(height, least + extra))
    left_out: list[Plot] = []
    while plots and area < _needed(plots):
        least_weight = min(plots, key=lambda plot: plot.weight)
        if least_weight.weight == max(plot.weight for plot in plots):
            break
        left_out.append(least_weight)
        plots.remove(least_weight)
    if left_out:
        names = ", ".join(plot.title[0].text if plot.title else plot.name for plot in left_out)
        lines = note_rows(f"no room for {names}", width)
        notes += lines
        area -= len(lines)
    left = max((_label_width(plot, area // len(plots)) for plot in plots), default=0)
    left = left if width - left >= 16 else 0
    places: tuple[PlotPlace, ...] = ()
    if plots and area >= (least if drawing.table is not None else 1):
        places = tuple(_stack(plots[:area], area))
        top = area
    table = top, max(0, height - len(notes) - top)
    return DrawingLayout(places, left, max(1, width - left), table, tuple(notes))


def note_rows(note: Note, width: int) -> list[tuple[Phrase, ...]]:
    """A note in rows of at most `width` cells."""
    if isinstance(note, str):
        return [(Phrase(line),) for line in textwrap.wrap(note, width)]
    rows: list[tuple[Phrase, ...]] = []
    free = -1
    for phrase in note:
        taken = cell_len(phrase.text) + 2 * (phrase.sign is not None)
        if taken + GAP > free and taken <= width:
            rows.append(())
            free = width + GAP
        if rows:
            rows[-1] = (*rows[-1], phrase)
        free -= taken + GAP
    return rows


def _write_phrases(
    canvas: Canvas, phrases: tuple[Phrase, ...], column: int, row: int, bold: bool = False
) -> int:
    """Write the phrases that fit, the first one `bold`; returns the column of the next text."""
    for number, phrase in enumerate(phrases):
        text = canvas.options.printable(phrase.whole(canvas.glyphs))
        if number and column + cell_len(text) > canvas.width:
            break
        colour = getattr(canvas.theme, phrase.ink)
        column = canvas.text(column, row, text, colour, bold=bold and not number) + GAP
    return column


def _has_head(plot: Plot) -> bool:
    return bool(plot.title or plot.legend)


def _has_axis(plots: list[Plot], place: int) -> bool:
    return place == len(plots) - 1 or plots[place].x != plots[place + 1].x


def _needed(plots: list[Plot]) -> int:
    """Rows of several plots at least."""
    return sum(
        _FEWEST_STACKED + _has_head(plot) + _has_axis(plots, place)
        for place, plot in enumerate(plots)
    )


def _stack(plots: list[Plot], area: int) -> list[PlotPlace]:
    """Plots of equal height in `area` rows; in low areas titles and axes are left out."""
    heads = sum(_has_head(plot) for plot in plots)
    axes = sum(_has_axis(plots, place) for place in range(len(plots)))
    with_axes = area >= len(plots) * 2 + axes
    with_heads = area >= len(plots) * 2 + axes + heads
    free = area - axes * with_axes - heads * with_heads
    places, top = [], 0
    for place, plot in enumerate(plots):
        head = top if with_heads and _has_head(plot) else None
        first = top + (head is not None)
        rows = max(1, free // (len(plots) - place))
        free -= rows
        axis = first + rows if with_axes and _has_axis(plots, place) else None
        places.append(PlotPlace(plot, head, first, rows, axis))
        top = first + rows + (axis is not None)
    return places


def _y_labels(plot: Plot, rows: int) -> dict[int, str]:
    """The labels of y by their rows."""
    found = plot.y.labels(rows, max(3, rows // 3), lambda text: 0.0, 1.0)
    return {row_of(plot.y, float(plot.y.value(tick / rows)), rows): text for _, tick, text in found}


def _label_width(plot: Plot, rows: int) -> int:
    widths = [cell_len(text) for text in _y_labels(plot, max(1, rows)).values() if text]
    return max(widths) + 1 if widths else 0


def draw_cells(drawing: Drawing, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """Draw the plots, the table and the notes in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    layout = drawing_layout(drawing, size)
    for place in layout.plots:
        _draw_plot(canvas, place, layout, drawing)
    end = layout.table[0]
    if drawing.table is not None:
        end = draw_table(canvas, drawing.table, *layout.table)
    last = min(end, canvas.height - len(layout.notes))
    for row, note in enumerate(layout.notes, start=last):
        _write_phrases(canvas, note, 0, row)
    return canvas


def drawing_panels(drawing: Drawing, size: Size) -> tuple[Panel, ...]:
    """The panels of the plots and the table in `size` (columns, rows)."""
    layout = drawing_layout(drawing, size)
    panels = tuple(_panel(place, layout) for place in layout.plots if place.plot.name)
    if drawing.table is None:
        return panels
    return (*panels, *table_panels(drawing.table, layout.table[0], size[0], layout.table[1]))


def drawing_table_layout(drawing: Drawing, size: Size) -> TableLayout | None:
    """The layout of the table in a drawing of `size`; None without a table."""
    room = drawing_layout(drawing, size).table[1]
    if drawing.table is None or room < 1:
        return None
    return table_layout(drawing.table, max(1, size[0]), room)


def _panel(place: PlotPlace, layout: DrawingLayout) -> Panel:
    """A range of x, whose last column includes what is beyond the axis."""
    x, y, bottom = place.plot.x, place.plot.y, place.top + place.rows

    def to_data(column: float, row: float) -> Point:
        return (
            float(x.value((column - layout.left) / layout.width)),
            float(y.value((bottom - row) / place.rows)),
        )

    def to_cells(at: float, height: float) -> Point:
        column = layout.left + float(x.fraction(at)) * layout.width
        return column, bottom - float(y.fraction(height)) * place.rows

    return Panel(
        place.plot.name, "range", layout.left, place.top, layout.width, place.rows,
        partial(to_data), partial(to_cells),
    )  # fmt: skip


def _draw_plot(canvas: Canvas, place: PlotPlace, layout: DrawingLayout, drawing: Drawing) -> None:
    """The title and the legend, the marks with the labels of y at the left, and the axis of x."""
    plot, theme = place.plot, canvas.theme
    if place.head is not None:
        _draw_head(canvas, plot, layout.left, place.head)
    if layout.left:
        for row, text in _y_labels(plot, place.rows).items():
            canvas.text(layout.left - 1, place.top + row, text, theme.muted, align="right")
    part = Canvas(layout.width, place.rows, canvas.options)
    draw_marks(part, plot, drawing.brush)
    canvas.paste(part, layout.left, place.top)
    if place.axis is not None:
        draw_axis(canvas, plot.x, layout.left, place.axis, layout.width, layout.width // _TICKS)


def _draw_head(canvas: Canvas, plot: Plot, left: int, row: int) -> None:
    """Title and legend, and the name of y at the right where there is room."""
    column = _write_phrases(canvas, plot.title, 0, row, bold=True) if plot.title else left
    for mark in plot.legend:
        glyph, colour = style_of(canvas, mark)
        if isinstance(mark, Line) and (mark.dashed or mark.ink not in ROLES):
            glyph = "- -" if mark.dashed else canvas.glyphs.horizontal
        if column + cell_len(glyph) + 1 + cell_len(mark.name) <= canvas.width:
            column = canvas.text(column, row, f"{glyph} {mark.name}", colour) + GAP
    name = plot.y.name(canvas.width - column, cell_len)
    canvas.text(canvas.width, row, name, canvas.theme.muted, align="right")


_MANY = 10_000
"""Lines in which every table that is printed fits."""


def text_lines(drawing: Drawing, width: int) -> list[str]:
    """The lines for a terminal of `width` columns, with all rows and their notes."""
    height = sum(len(note_rows(note, width)) for note in drawing.notes)
    if drawing.table is not None:
        height += table_layout(drawing.table, width, _MANY).end
    canvas = draw_cells(replace(drawing, plots=()), (width, max(1, 2 * height)))
    lines = [line.rstrip() for line in canvas.lines()]
    while lines and not lines[-1]:
        lines.pop()
    return lines
