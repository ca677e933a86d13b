"""Draw the table and the notes of a `Drawing` as lines of text, as commands print them."""

from __future__ import annotations

from dataclasses import replace

from s2rtui.drawing.cells import draw_cells, note_rows
from s2rtui.drawing.plot import Drawing
from s2rtui.drawing.table_layout import table_layout

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
