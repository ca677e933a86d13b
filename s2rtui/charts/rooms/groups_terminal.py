"""The table of groups in cells: a row per group, and its errors on a scale where there is room."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from rich.cells import cell_len

from s2rstore.findings.groups import GroupErrors
from s2rstore.index.population import INCLUDE_HINT
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Panel, Point, RenderOptions, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.marks import mark_rows
from s2rtui.charts.rooms.groups import GroupsInput, TableColumn, fitting_columns, ordered
from s2rtui.drawing.scale import scale_fraction, short_number

PANEL = "groups"
_PLOT = 16
"""Fewest columns of the scale of errors."""
_GUTTER = 2
"""Columns before the names, for the brush and the cursor."""


@dataclass(frozen=True, slots=True, eq=False)
class GroupsLayout:
    """Rows in their order, the columns beside the names, and where each part is in cells.

    name: width of the names. starts: first cell of each column. plot: (first cell, width) of the
    scale of errors, or None. first, shown: the visible rows; top: the line of the first one.
    """

    rows: list[GroupErrors]
    columns: list[TableColumn]
    name: int
    starts: tuple[int, ...]
    plot: tuple[int, int] | None
    first: int
    shown: int
    top: int


def groups_layout(data: GroupsInput, size: Size) -> GroupsLayout:
    """Lay out the table; the window follows the brush mark, scrolling, or the cursor's group."""
    width, height = max(1, size[0]), max(1, size[1])
    rows = ordered(data)
    columns = fitting_columns(data, rows, width)
    used = sum(column.width + 1 for column in columns)
    top = 1 if height >= 2 else 0
    shown = min(len(rows), height - top)
    title = data.grouping if shown == len(rows) else "{0}-{0}/{0}".format(len(rows))
    longest = max([cell_len(row.group.name) for row in rows] + [len(title) + 1])
    name = max(0, min(longest, width - used - _GUTTER))
    starts, x = [], _GUTTER + name + 1
    for column in columns:
        starts.append(x)
        x += column.width + 1
    plot = (x + 1, width - x - 2) if width - x - 2 >= _PLOT else None
    first = min(max(0, _first(data, rows, shown)), len(rows) - shown)
    return GroupsLayout(rows, columns, name, tuple(starts), plot, first, shown, top)


def _first(data: GroupsInput, rows: Sequence[GroupErrors], shown: int) -> int:
    """The wanted first row of `shown` ones."""
    if data.mark is not None and data.mark.points:
        return round(data.mark.points[-1][1]) - shown // 2
    if data.first is not None:
        return data.first
    at = next((place for place, row in enumerate(rows) if row.group.name == data.cursor), 0)
    return at - shown // 2 if at >= shown else 0


def groups_panels(
    data: GroupsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """One panel; y is the index of a row of the table."""
    layout = groups_layout(data, size)
    if not layout.shown:
        return ()
    to_data, to_cells = partial(_to_data, layout), partial(_to_cells, layout)
    width = max(1, size[0])
    return (Panel(PANEL, "steps", 0, layout.top, width, layout.shown, to_data, to_cells),)


def _to_data(layout: GroupsLayout, column: float, row: float) -> Point:
    held = min(max(math.floor(row) - layout.top, 0), layout.shown - 1)
    return column, float(layout.first + held)


def _to_cells(layout: GroupsLayout, x: float, y: float) -> Point:
    return x, layout.top + round(y) - layout.first + 0.5


def draw_groups(data: GroupsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """The table in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    theme = options.theme
    if not data.rows:
        text = "no instances"
        if data.has_trained and not data.with_trained:
            text = f"no instance is new to the run: {INCLUDE_HINT}"
        canvas.text(0, 0, text[: canvas.width], theme.muted)
        return canvas
    layout = groups_layout(data, (canvas.width, canvas.height))
    if layout.top:
        _header(canvas, data, layout)
    low, high = (-1, -2) if data.mark is None else mark_rows(data.mark)
    for line in range(layout.shown):
        index = layout.first + line
        _row(canvas, data, layout, index, layout.top + line, low <= index <= high)
    return canvas


def _header(canvas: Canvas, data: GroupsInput, layout: GroupsLayout) -> None:
    theme = canvas.theme
    down, up = ("v", "^") if canvas.options.ascii else ("▼", "▲")
    arrow = down if data.descending else up
    by_name = data.sort == "group"
    title, ink = data.grouping, theme.text if by_name else theme.muted
    if layout.shown < len(layout.rows):
        title = f"{layout.first + 1}-{layout.first + layout.shown}/{len(layout.rows)}"
    canvas.text(_GUTTER, 0, (title + arrow * by_name)[: layout.name], ink, bold=by_name)
    for column, start in zip(layout.columns, layout.starts, strict=True):
        sorts = data.sort in column.sorts
        ink = theme.text if sorts else theme.muted
        text = column.title + arrow * sorts
        canvas.text(start + column.width, 0, text, ink, bold=sorts, align="right")
    if layout.plot is not None:
        left, width = layout.plot
        real, sim = canvas.glyphs.selected, canvas.glyphs.sim
        canvas.text(left, 0, "0", theme.muted)
        end = f"{short_number(_longest(data))} m"
        legend = f"{real} real  {sim} sim"
        if len(legend) > width - len(end) - 3:
            legend = f"{real} {sim}"
        canvas.text(left + 2, 0, legend, theme.muted)
        canvas.text(left + width, 0, end, theme.muted, align="right")


def _row(
    canvas: Canvas, data: GroupsInput, layout: GroupsLayout, index: int, y: int, held: bool
) -> None:
    theme, glyphs, row = canvas.theme, canvas.glyphs, layout.rows[index]
    is_selected = data.selected.get(row.group.name, 0) > 0
    ink = theme.text if is_selected else theme.muted
    if held:
        canvas.fill(0, y, canvas.width, 1, theme.highlight)
        canvas.put(0, y, glyphs.pointer, theme.truth, bold=True)
    if row.group.name == data.cursor:
        canvas.put(1, y, glyphs.cursor, theme.cursor, bold=True)
    name = canvas.options.printable(row.group.name)
    name = fit_text(name, layout.name, glyphs.ellipsis)
    canvas.text(_GUTTER, y, name, ink, bold=is_selected)
    for column, start in zip(layout.columns, layout.starts, strict=True):
        colour = {"real": theme.real, "sim": theme.sim}.get(column.title, ink)
        canvas.text(start + column.width, y, column.texts[index], colour, align="right")
    if layout.plot is not None:
        _scale(canvas, data, row, y, layout.plot)


def _scale(
    canvas: Canvas, data: GroupsInput, row: GroupErrors, y: int, plot: tuple[int, int]
) -> None:
    """Median real error with its interval, and the median sim error, from 0 on the left."""
    theme, glyphs, (left, width) = canvas.theme, canvas.glyphs, plot
    scale = 0.0, _longest(data)

    def column(value: float) -> int:
        return left + round(float(scale_fraction(value, scale)) * (width - 1))

    if row.real.is_known:
        start, stop = map(column, row.real.bounds)
        canvas.hline(start, stop, y, glyphs.interval, theme.real)
    canvas.put(column(row.sim), y, glyphs.sim, theme.sim)
    canvas.put(column(row.real.value), y, glyphs.selected, theme.real, bold=True)


def _longest(data: GroupsInput) -> float:
    """The right end of the scale: the largest bound or median."""
    ends = (end for row in data.rows for end in (row.real.bounds[1], row.real.value, row.sim))
    return max((end for end in ends if math.isfinite(end)), default=1.0) or 1.0
