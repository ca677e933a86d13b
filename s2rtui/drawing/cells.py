"""Draw a `Drawing` in character cells, and its panels, which take the mouse and brushes."""

from __future__ import annotations

from dataclasses import replace

from rich.cells import cell_len

from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import (
    DEFAULT_OPTIONS,
    Canvas,
    InlineImage,
    Pixels,
    PlotArea,
    Point,
    RenderOptions,
    Size,
    Theme,
)
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.marks import draw_ground, draw_mark, wrap_degrees
from s2rtui.canvas.raster import limit_ground
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.drawing_layout import (
    PlotPlace,
    beside_images,
    dividers,
    drawing_layout,
    has_head,
    note_rows,
    title_width,
    y_labels,
)
from s2rtui.drawing.legend import draw_rows
from s2rtui.drawing.plane_marks import Floor
from s2rtui.drawing.plot import ROLES, Line
from s2rtui.drawing.plot_cells import dial_of, dial_panel, draw_dial, draw_marks, style_of
from s2rtui.drawing.table_cells import draw_axis, draw_table, table_panels
from s2rtui.drawing.table_layout import GAP, table_layout

_TICKS = 8
"""Columns of a plot for each tick of its axis."""


def draw_cells(drawing: Drawing, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """Draw the plots, the table and the notes in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    for part, left, width in beside_images(drawing, size, options) or ():
        canvas.paste(draw_cells(part, (width, size[1]), options), left, 0)
        if part.table is not None:
            return canvas
    layout = drawing_layout(drawing, size, options)
    for place in layout.plots:
        _draw_plot(canvas, place, drawing)
    for column in dividers(layout):
        last = layout.table[0] - 1
        canvas.vline(column, 0, last, canvas.glyphs.vertical, canvas.theme.faint)
    end = layout.table[0]
    draw_rows(canvas, 0, end - len(layout.bars), layout.bars)
    if drawing.table is not None:
        end = draw_table(canvas, drawing.table, *layout.table)
        if drawing.brush is not None:
            for panel in table_panels(drawing.table, layout.table[0], size[0], layout.table[1]):
                draw_ground(canvas, panel, drawing.brush)
                draw_mark(canvas, panel, drawing.brush)
    draw_rows(canvas, 0, min(end, canvas.height - len(layout.notes)), layout.notes)
    return canvas


def drawing_panels(
    drawing: Drawing, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[PlotArea, ...]:
    """The panels of the plots and the table in `size` (columns, rows)."""
    if (parts := beside_images(drawing, size, options)) is not None:
        drawing, size = parts[0][0], (parts[0][2], size[1])
    layout = drawing_layout(drawing, size, options)
    panels = tuple(_panel(place) for place in layout.plots if place.plot.name)
    if drawing.table is None:
        return panels
    return (*panels, *table_panels(drawing.table, layout.table[0], size[0], layout.table[1]))


def text_lines(drawing: Drawing, width: int) -> list[str]:
    """The table and the notes for a terminal of `width` columns, with all rows and their notes."""
    height = len(note_rows(drawing.notes, width, DEFAULT_OPTIONS))
    if drawing.table is not None:
        height += table_layout(drawing.table, width).end
    canvas = draw_cells(replace(drawing, plots=()), (width, max(1, 2 * height)))
    lines = [line.rstrip() for line in canvas.lines()]
    while lines and not lines[-1]:
        lines.pop()
    return lines


def _panel(place: PlotPlace) -> PlotArea:
    """The area of a plot; the last column of a range includes what is beyond the axis."""
    if place.plot.turns:
        return dial_panel(place.plot, place.left, place.top, place.width, place.rows)
    x, y, bottom = place.plot.x, place.plot.y, place.top + place.rows
    is_turn = place.plot.shape == "turn"

    def to_data(column: float, row: float) -> Point:
        at = float(x.value((column - place.left) / place.width))
        return wrap_degrees(at) if is_turn else at, float(y.value((bottom - row) / place.rows))

    def to_cells(at: float, height: float) -> Point:
        across = float(x.fraction(wrap_degrees(at) if is_turn else at))
        column = place.left + across * place.width
        return column, bottom - float(y.fraction(height)) * place.rows

    return PlotArea(
        place.plot.name, place.plot.shape, place.left, place.top, place.width, place.rows,
        to_data, to_cells,
    )  # fmt: skip


def _draw_plot(canvas: Canvas, place: PlotPlace, drawing: Drawing) -> None:
    """The title and the legend, the marks with what is at their left, and the axis of x.

    Below a dial the texts of its title that follow its name stand in place of the axis.
    """
    plot, theme = place.plot, canvas.theme
    if place.head is not None:
        _draw_head(canvas, place)
    if place.left > place.start:
        _draw_left(canvas, place)
    part = Canvas(place.width, place.rows, canvas.options)
    panel = _panel(replace(place, left=0, top=0)) if plot.name and not plot.turns else None
    if panel is not None:
        draw_ground(part, panel, drawing.brush)
    texts = None
    if plot.turns:
        draw_dial(part, plot, drawing.brush)
    else:
        texts = draw_marks(part, plot)
    marked = part.char.copy()
    if panel is not None:
        draw_mark(part, panel, drawing.brush)
    if any(isinstance(mark, Floor) for mark in plot.marks):
        limit_ground(part)
    shows = plot.image is None and (drawing.brush is None or plot.shape == "plane")
    if canvas.options.supports_shading and shows:
        part.images.append(_image(place, canvas.theme))
        part.show_text((part.char != marked) if texts is None else texts | (part.char != marked))
    canvas.paste(part, place.left, place.top)
    if place.axis is not None and plot.turns:
        texts_below = [phrase.whole(canvas.glyphs, place.width) for phrase in plot.title[1:]]
        text = canvas.options.printable((" " * GAP).join(texts_below))
        start = place.left + (place.width - cell_len(text)) // 2
        canvas.text(start, place.axis, text, theme.muted)
    elif place.axis is not None:
        draw_axis(canvas, plot.x, place.left, place.axis, place.width, place.width // _TICKS)


def _draw_left(canvas: Canvas, place: PlotPlace) -> None:
    """The labels of y; where no row shows the title, its first text and the name of y, if any."""
    plot, theme, room = place.plot, canvas.theme, place.left - place.start - 1
    if place.head is None and 0 < title_width(plot) <= room:
        name = plot.title[0]
        text = canvas.options.printable(name.whole(canvas.glyphs))
        canvas.text(place.start, place.top, text, getattr(theme, name.ink), bold=True)
        if place.axis is not None:
            canvas.text(place.start, place.axis, plot.y.name(room, cell_len), theme.muted)
        return
    for row, text in y_labels(plot, place.rows).items():
        if cell_len(text) <= room:
            canvas.text(place.left - 1, place.top + row, text, theme.muted, align="right")
    if not has_head(plot):
        text = plot.y.name(room + 1, cell_len).ljust(room + 1)
        canvas.text(place.start, place.top, text, theme.muted)


def _image(place: PlotPlace, theme: Theme) -> InlineImage:
    """The marks in true pixels, for terminals with graphics."""
    plot = place.plot
    x, y, width, height = 0, 0, place.width, place.rows
    if plot.turns:
        x, y, width, height = dial_of(plot, width, height).box

    def pixels(size: Size) -> Pixels:
        from s2rtui.drawing.plot_paper import dial_pixels, plot_pixels

        if plot.turns:
            return dial_pixels(plot, theme, size)
        return plot_pixels(plot, theme, size, place.width)

    key = identity_key((theme.name, place.width, place.rows, plot))
    return InlineImage(x, y, width, height, None, pixels, key)


def _draw_head(canvas: Canvas, place: PlotPlace) -> None:
    """Title and legend, and the name of y at the right, where there is room."""
    plot, stop = place.plot, place.left + place.width
    column = place.start if plot.title else place.left
    title = plot.title[:1] if plot.turns and place.axis is not None else plot.title
    for number, phrase in enumerate(title):
        room = stop - column if number else place.width
        text = canvas.options.printable(phrase.whole(canvas.glyphs, room))
        if number and column + cell_len(text) > stop:
            break
        colour = getattr(canvas.theme, phrase.ink)
        text = fit_text(text, stop - column)
        column = canvas.text(column, place.head or 0, text, colour, bold=not number) + GAP
    for mark in plot.legend:
        glyph, colour = style_of(canvas, mark)
        if isinstance(mark, Line) and (mark.dashed or mark.ink not in ROLES):
            glyph = "- -" if mark.dashed else canvas.glyphs.horizontal
        if column + cell_len(glyph) + 1 + cell_len(mark.name) <= stop:
            text = f"{glyph} {mark.name}"
            column = canvas.text(column, place.head or 0, text, colour) + GAP
    name = "" if plot.image is not None else plot.y.name(stop - column, cell_len)
    canvas.text(stop, place.head or 0, name, canvas.theme.muted, align="right")
