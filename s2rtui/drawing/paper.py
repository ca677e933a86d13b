"""Draw a `Drawing` on a page with matplotlib."""

from __future__ import annotations

import math

from s2rtui.canvas import Theme
from s2rtui.canvas.render_options import UNICODE
from s2rtui.drawing.drawing import Drawing, Note
from s2rtui.drawing.page import LETTER, NARROW, Page, Pixels, new_page, own_settings
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.plot_paper import LEGEND_COLUMNS, draw_plot
from s2rtui.drawing.table import TableSpec
from s2rtui.drawing.table_layout import table_layout
from s2rtui.drawing.table_paper import (
    LINE,
    MARGIN,
    draw_table,
    sentences,
    table_inches,
    wrapped,
)

_BELOW, _LEFT, _RIGHT = 0.7, 0.75, 0.25
"""Inches below the axes of a plot; at its left and at its right."""
_TITLE, _LEGEND_LINE = 0.3, 0.2
"""Inches of the title of a plot, and of a line of its legend."""
_SMALLEST_FONT, _SMALLEST_TABLE_FONT = 4.0, 6.0
_MANY = 10_000
"""Lines in which every table fits."""
_LEAST_SHARE = 0.35
"""Share of the page below its heading that plots have at least."""


@own_settings()
def draw_paper(
    drawing: Drawing, size: Pixels, theme: Theme, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the plots above the table and the notes, in `size` pixels.

    A table whose columns do not fit beside each other becomes sentences, or leaves out columns.
    Rows that would leave the plots too little room are left out, and a line says so.
    """
    page = new_page(size, theme, title, subtitle)
    font = 8 if page.inches[0] <= NARROW else 9
    letters = int((page.inches[0] - 2 * MARGIN) / (LETTER * font))
    notes = [line for note in drawing.notes for line in wrapped(_text(note), letters)]
    table, texts = drawing.table, None
    if table is not None and (texts := sentences(table, letters)) is not None:
        table = None
    top, below = page.top, 0.1 + (len(notes) + 1.5) * LINE
    if drawing.plots:
        most = (1 - _LEAST_SHARE) * page.top - below
        if texts is not None and len(texts) * LINE > most:
            kept = max(0, int(most / LINE) - 1)
            texts = [*texts[:kept], f"and {len(texts) - kept} more lines: `s2r show`"]
        height = (
            table_inches(table, letters, font) if table is not None else LINE * len(texts or ())
        )
        below += min(height, most)
        _draw_plots(page, drawing.plots, below)
        top = below
    for row, text in enumerate(texts or ()):
        page.text(MARGIN, top - (row + 1) * LINE, text, page.inks.muted, font)
    if table is not None:
        low = 0.1 + (len(notes) + (1.0 if notes else 0.5)) * LINE
        top -= 0.5 * LINE * (not drawing.plots)
        draw_table(page, table, top, low, _fitting_font(page, table, top - low, font))
    for row, text in enumerate(reversed(notes)):
        page.text(MARGIN, 0.1 + row * LINE, text, page.inks.muted, font)
    return page.encoded()


def _fitting_font(page: Page, table: TableSpec, room: float, font: float) -> float:
    """The largest font of which no column is cut, and all texts fit into `room` inches."""
    wraps = any(column.wraps for column in table.columns)
    has_texts = wraps or any(row.notes for row in table.rows[:1])
    while font > (_SMALLEST_FONT if wraps else _SMALLEST_TABLE_FONT):
        letters = int((page.inches[0] - 2 * MARGIN) / (LETTER * font))
        is_low = has_texts and table_inches(table, letters, font) > room
        if not is_low and not table_layout(table, letters, _MANY).is_tight:
            break
        font -= 0.5
    return font


def _text(note: Note) -> str:
    if isinstance(note, str):
        return note
    return "   ".join(phrase.whole(UNICODE) for phrase in note)


def _draw_plots(page: Page, plots: tuple[Plot, ...], below: float) -> None:
    """Plots of equal height above `below` inches; those with the same scale share its labels."""
    heads = [
        _TITLE if plot.title else math.ceil(len(plot.legend) / LEGEND_COLUMNS) * _LEGEND_LINE
        for plot in plots
    ]
    has_axis = [place == len(plots) - 1 or plot.x != plots[place + 1].x
                for place, plot in enumerate(plots)]  # fmt: skip
    feet = [_BELOW if each else 0.12 for each in has_axis]
    height = max(0.2, (page.top - below - 0.15 - sum(heads) - sum(feet)) / len(plots))
    top, width = page.top - 0.15, page.inches[0] - _LEFT - _RIGHT
    for place, (plot, head, foot) in enumerate(zip(plots, heads, feet, strict=True)):
        axes = page.axes(_LEFT, top - head - height, width, height)
        alike = [at for at, other in enumerate(plots) if other.y == plot.y]
        has_name = place == alike[len(alike) // 2]  # one name for plots with the same scale of y
        draw_plot(axes, page, plot, (width, height), has_axis[place], has_name)
        top -= head + height + foot
