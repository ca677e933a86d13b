"""The errors in cells: histograms of sim and real, with the median of the selected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from rich.cells import cell_len

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Mark, Panel, Point, RenderOptions, Rgb, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.marks import mark_on_panel, mark_range
from s2rtui.charts.errors.model import NAMES, ErrorsInput, ErrorsModel, SideErrors, errors_model
from s2rtui.charts.shared.bars import draw_vertical_bars, put_over_bar
from s2rtui.drawing.scale import short_number, tick_step, tick_text, tick_values

LABELS = 15
"""Columns of names and numbers at the left."""


@dataclass(frozen=True, slots=True)
class ErrorsLayout:
    """First column and width of the bars; (first row, rows) per side; the row of the axis."""

    left: int
    width: int
    sides: tuple[tuple[int, int], ...]
    axis: int | None


def errors_layout(size: Size) -> ErrorsLayout:
    """Lay out both sides in equal heights above one axis; a single row shows only sim."""
    width, height = max(1, size[0]), max(1, size[1])
    left = LABELS if width >= 24 else 0
    axis = height - 1 if height >= 5 else None
    rows = height - (axis is not None)
    upper = (rows + 1) // 2
    sides = ((0, upper), (upper, rows - upper))
    return ErrorsLayout(left, width - left, tuple(side for side in sides if side[1]), axis)


def errors_panels(
    data: ErrorsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """Ranges "sim" and "real": x is the error, y a count on the scale that both share.

    The last column includes all larger errors.
    """
    layout = errors_layout(size)
    model = errors_model(data, layout.width)
    panels = []
    for name, (top, rows) in zip(NAMES, layout.sides, strict=False):
        corner, scale = (layout.left, top + rows), (model.upper / layout.width, model.peak / rows)
        to_data = partial(_to_data, corner, scale)
        to_cells = partial(_to_cells, corner, scale)
        panels.append(Panel(name, "range", layout.left, top, layout.width, rows, to_data, to_cells))
    return tuple(panels)


def _to_data(corner: tuple[int, int], scale: Point, column: float, row: float) -> Point:
    return (column - corner[0]) * scale[0], (corner[1] - row) * scale[1]


def _to_cells(corner: tuple[int, int], scale: Point, x: float, y: float) -> Point:
    return corner[0] + x / scale[0], corner[1] - y / scale[1]


def draw_errors(data: ErrorsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """Draw both histograms in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    layout = errors_layout((canvas.width, canvas.height))
    model = errors_model(data, layout.width)
    panels = errors_panels(data, (canvas.width, canvas.height), options)
    theme, glyphs = options.theme, options.glyphs
    for panel, errors, glyph, colour in zip(
        panels,
        (model.sim, model.real),
        (glyphs.sim, glyphs.real),
        (theme.sim, theme.real),
        strict=False,
    ):
        mark = mark_on_panel(data.mark, panel.name)
        _side(canvas, panel, errors, model.peak, mark, colour)
        if layout.left:
            _labels(canvas, panel, errors, f"{glyph} {panel.name}", colour)
    if layout.axis is not None:
        _axis(canvas, layout, model, data)
    return canvas


def _labels(canvas: Canvas, panel: Panel, errors: SideErrors, name: str, colour: Rgb) -> None:
    canvas.text(0, panel.y, name, colour)
    lines = [f"median {short_number(errors.median, 2)}", _most(errors.peak)]
    for row, line in enumerate(lines[: panel.height - 1], start=1):
        canvas.text(0, panel.y + row, fit_text(line, LABELS - 1), canvas.theme.muted)


def _most(count: int) -> str:
    return f"peak {count}" if count < 100_000 else f"peak {count // 1000}k"


def _side(
    canvas: Canvas, panel: Panel, errors: SideErrors, peak: int, mark: Mark | None, colour: Rgb
) -> None:
    """Bars, brush mark, the median as a line, and the cursor at the bottom.

    peak: the count of a bar of full height.
    """
    theme, bottom = canvas.theme, panel.y + panel.height - 1
    ends: list[int] = []
    if mark is not None:
        ends = [_column(panel, x) for x in mark_range(mark)]
        wide = ends[1] - ends[0] + 1
        canvas.fill(ends[0], panel.y, wide, panel.height, theme.highlight)
    bars = (errors.highlighted / peak, errors.total / peak)
    draw_vertical_bars(canvas, panel.x, panel.y, panel.height, bars, colour)
    if math.isfinite(errors.median):
        at = _column(panel, errors.median)
        for row in range(panel.y, bottom + 1):
            put_over_bar(canvas, at, row, canvas.glyphs.baseline, theme.text)
    for at, glyph in zip(ends, (canvas.glyphs.scale_left, canvas.glyphs.scale_right), strict=False):
        for row in range(panel.y, bottom + 1):
            canvas.put(at, row, glyph, theme.truth, bold=True)
    if errors.cursor is not None:
        at = _column(panel, errors.cursor)
        put_over_bar(canvas, at, bottom, canvas.glyphs.cursor, theme.cursor)


def _column(panel: Panel, error: float) -> int:
    """The column of an error, clipped to the last one."""
    column = int(np.floor(panel.to_cells(error, 0.0)[0] + 1e-9))
    return min(max(column, panel.x), panel.x + panel.width - 1)


def _axis(canvas: Canvas, layout: ErrorsLayout, model: ErrorsModel, data: ErrorsInput) -> None:
    upper, row, chart = model.upper, canvas.height - 1, layout.width
    count = max(1, chart // 8)
    width = tick_step(upper, count)
    name = f"{data.label} {data.unit}".strip()
    beyond = model.sim.beyond + model.real.beyond
    if beyond and chart >= 60:
        name = f"{name}, last bar: {short_number(upper, 2)} and more"
    elif beyond and chart >= 30:
        name = f"{name}, last {short_number(upper, 2)}+"
    stop = canvas.width - cell_len(name) - 1
    free = layout.left
    for tick in tick_values(0.0, upper, count):
        text = tick_text(tick, width) if width < 1e4 else short_number(tick)
        start = layout.left + min(chart - 1, int(tick / upper * chart))
        if start >= free and start + len(text) <= stop:
            free = canvas.text(start, row, text, canvas.theme.muted) + 1
    if stop > layout.left:
        canvas.text(canvas.width, row, name, canvas.theme.muted, align="right")
