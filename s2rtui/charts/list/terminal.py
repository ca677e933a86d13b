"""The list in cells: rows around the cursor, and the columns that fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Panel, RenderOptions, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.list.model import ListColumn, ListInput, cursor_row


@dataclass(frozen=True, slots=True)
class ListLayout:
    """starts: the first cell of each visible column; first: the index of the row on line `top`;
    shown: number of visible rows.
    """

    starts: tuple[int, ...]
    first: int
    shown: int
    top: int

    def row_at(self, y: int) -> int | None:
        """The index of the row on line `y`, or None."""
        index = y - self.top
        return self.first + index if 0 <= index < self.shown else None


def list_layout(data: ListInput, size: Size) -> ListLayout:
    """Lay out the list in `size` (columns, rows); the cursor's row is always visible."""
    width, height = size
    starts: list[int] = []
    x = 2
    for column in data.columns:
        if starts and x + column.width > width:
            break
        starts.append(x)
        x += column.width + 2
    top = 1 if height > 1 else 0
    space = max(1, height - top)
    at = cursor_row(data)
    first = 0 if at is None else min(max(0, at - space // 2), max(0, data.rows.size - space))
    return ListLayout(tuple(starts), first, min(space, data.rows.size - first), top)


def draw_list(data: ListInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    theme = options.theme
    layout = list_layout(data, (canvas.width, canvas.height))
    if not data.rows.size:
        canvas.text(0, 0, "nothing is selected", theme.muted)
        return canvas
    if layout.top:
        for start, column in zip(layout.starts, data.columns, strict=False):
            title = column.title + (_arrow(data, options) if column.sorts else "")
            ink = theme.text if column.sorts else theme.muted
            _cell(canvas, start, 0, column, title, ink, column.sorts)
    for line in range(layout.shown):
        iid = int(data.rows[layout.first + line])
        y, here = layout.top + line, iid == data.cursor
        if here:
            canvas.fill(0, y, canvas.width, 1, theme.highlight)
            canvas.put(0, y, options.glyphs.pointer, theme.text, bold=True)
        for start, column in zip(layout.starts, data.columns, strict=False):
            text = options.printable(column.text(iid))
            _cell(canvas, start, y, column, text, theme.text, here)
    return canvas


def _arrow(data: ListInput, options: RenderOptions) -> str:
    down, up = ("v", "^") if options.ascii else ("▼", "▲")
    return down if data.descending else up


def _cell(
    canvas: Canvas,
    x: int,
    y: int,
    column: ListColumn,
    text: str,
    ink: tuple[int, int, int],
    bold: bool,
) -> None:
    text = fit_text(text, column.width)
    if column.right:
        canvas.text(x + column.width, y, text, ink, bold=bold, align="right")
    else:
        canvas.text(x, y, text, ink, bold=bold)


def list_panels(
    data: ListInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """One panel; y is the index of a row of the list."""
    layout = list_layout(data, size)
    if not layout.shown:
        return ()

    def to_data(column: float, row: float) -> tuple[float, float]:
        return 0.0, float(math.floor(row) - layout.top + layout.first)

    def to_cells(x: float, y: float) -> tuple[float, float]:
        return 0.5, y - layout.first + layout.top + 0.5

    return (Panel("rows", "steps", 0, layout.top, size[0], layout.shown, to_data, to_cells),)
