"""The overview in cells: a row per run, marks for sim and real accuracy, instances as lines."""

from __future__ import annotations

from collections.abc import Sequence

from rich.cells import cell_len

from s2rtui.canvas import DEFAULT_OPTIONS, BrushShape, Canvas, RenderOptions, Rgb, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.marks import mark_on_panel, mark_range
from s2rtui.charts.overview.layout import OverviewLayout, overview_layout, overview_panels
from s2rtui.charts.overview.lines import draw_lines, pale_colour
from s2rtui.charts.overview.model import (
    OverviewLines,
    OverviewModel,
    cursor_accuracies,
    overview_model,
)
from s2rtui.charts.scene import OverviewRow
from s2rtui.drawing.scale import tick_step, tick_text, tick_values


def draw_overview(
    rows: Sequence[OverviewRow],
    baseline: float | None,
    selected: int | None,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    lines: OverviewLines | None = None,
    mark: BrushShape | None = None,
) -> Canvas:
    """Draw the overview in `size` (columns, rows); `selected` is an index into `rows`.

    With `lines` each instance is a line across the runs, and the axis includes them.
    """
    canvas = Canvas(*size, options)
    if not rows:
        canvas.text(0, 0, "no run has been computed", options.theme.muted)
        return canvas
    model = overview_model(rows, baseline, lines)
    layout = overview_layout(model.rows, selected, (canvas.width, canvas.height), lines)
    if layout.top:
        _header(canvas, layout, lines)
    if selected is not None and layout.first <= selected < layout.first + layout.shown:
        y = layout.row_of(selected)
        canvas.fill(0, y, canvas.width, 1, options.theme.highlight)
        canvas.put(0, y, options.glyphs.pointer, options.theme.text, bold=True)
    if lines is not None and layout.chart_width:
        draw_lines(canvas, lines, model.axis, layout)
    accuracies = cursor_accuracies(lines) if lines is not None else []
    for index in range(layout.first, layout.first + layout.shown):
        _line(canvas, model, index, layout, index == selected)
        if lines is not None:
            _draw_cursor_accuracy(canvas, model, index, accuracies[index], layout)
    if lines is not None and layout.chart_width and model.baseline is not None:
        _baseline(canvas, layout.column(model.baseline, model.axis), layout)
    if layout.axis_rows:
        _axis(canvas, layout.top + layout.height, model, layout)
    if mark is not None:
        _mark(canvas, rows, baseline, selected, lines, mark)
    return canvas


def _header(canvas: Canvas, layout: OverviewLayout, lines: OverviewLines | None) -> None:
    theme, glyphs = canvas.theme, canvas.glyphs
    canvas.text(2, 0, fit_text("run", layout.name), theme.muted)
    if layout.chart_width:
        _chart_header(canvas, layout, lines)
    if layout.numbers < canvas.width:
        canvas.text(layout.numbers + 5, 0, f"{glyphs.sim} sim", theme.sim, align="right")
        canvas.text(layout.numbers + 12, 0, f"{glyphs.real} real", theme.real, align="right")
    if layout.cursor_numbers and lines is not None:
        name = f"{glyphs.cursor} {lines.cursor}"
        fits = name if cell_len(name) < layout.cursor_numbers else glyphs.cursor
        canvas.text(canvas.width, 0, fits, theme.cursor, align="right")


def _chart_header(canvas: Canvas, layout: OverviewLayout, lines: OverviewLines | None) -> None:
    """Names of accuracy, baseline, and the side of the lines."""
    theme, glyphs = canvas.theme, canvas.glyphs
    free, stop = layout.chart, layout.chart + layout.chart_width
    pieces: list[tuple[str, Rgb]] = [("accuracy %", theme.muted)]
    if layout.chart_width < 24 or (lines is not None and layout.chart_width < 36):
        pieces = [("acc. %", theme.muted)]
    if lines is not None:
        colour = getattr(theme, lines.side)
        drawn = "bands" if lines.banded[0] else "lines"
        pieces.append((f"{drawn}: {lines.side}", colour))
        if lines.trained is not None:
            dark = pale_colour(colour, theme)
            pieces.append((f"{glyphs.trained if canvas.options.ascii else 'pale:'} trained", dark))
    if layout.chart_width >= 24:
        pieces.append((f"{glyphs.baseline} baseline", theme.muted))
    for text, colour in pieces:
        if text == pieces[0][0] or free + cell_len(text) <= stop:
            free = canvas.text(free, 0, fit_text(text, stop - free), colour) + 2


def _line(
    canvas: Canvas, model: OverviewModel, index: int, layout: OverviewLayout, bold: bool
) -> None:
    row, theme, y = model.rows[index], canvas.theme, layout.row_of(index)
    name = fit_text(row.run, layout.name, canvas.glyphs.ellipsis)
    shown_name = canvas.options.printable(name) if layout.name else ""
    canvas.text(2, y, shown_name, theme.text, bold=bold)
    if layout.chart_width:
        _marks(canvas, y, model, row, layout)
    if layout.numbers < canvas.width:
        for value, right, colour in (
            (row.sim_accuracy, 5, theme.sim),
            (row.real_accuracy, 12, theme.real),
        ):
            text = "n/a" if value is None else f"{100 * value:.1f}"
            shade = theme.muted if value is None else colour
            canvas.text(layout.numbers + right, y, text, shade, bold=bold, align="right")


def _marks(
    canvas: Canvas, y: int, model: OverviewModel, row: OverviewRow, layout: OverviewLayout
) -> None:
    theme, glyphs = canvas.theme, canvas.glyphs
    sides = (
        (row.sim_accuracy, row.sim_interval, theme.sim, glyphs.sim),
        (row.real_accuracy, row.real_interval, theme.real, glyphs.real),
    )
    for _, interval, colour, _ in sides:
        if interval is not None:
            ends = [layout.column(value, model.axis) for value in interval]
            canvas.hline(ends[0], ends[1], y, glyphs.interval, colour)
    places = [None if value is None else layout.column(value, model.axis) for value, *_ in sides]
    sim, real = places
    if sim is not None and real is not None and abs(sim - real) > 1:
        low, high = sorted((sim, real))
        worse = (row.real_accuracy or 0.0) < (row.sim_accuracy or 0.0)
        canvas.hline(low + 1, high - 1, y, glyphs.bar, theme.muted if worse else theme.truth)
    if model.baseline is not None:
        canvas.put(layout.column(model.baseline, model.axis), y, glyphs.baseline, theme.truth)
    if sim is not None and sim == real:
        canvas.put(sim, y, glyphs.both, theme.text, bold=True)
        return
    for place, (_, _, colour, glyph) in zip(places, sides, strict=True):
        if place is not None:
            canvas.put(place, y, glyph, colour, bold=True)
    if sim is None and real is None:
        note = f"{row.note or 'n/a'} "
        canvas.text(layout.chart, y, fit_text(note, layout.chart_width), theme.muted)


def _draw_cursor_accuracy(
    canvas: Canvas, model: OverviewModel, index: int, value: float | None, layout: OverviewLayout
) -> None:
    """The accuracy of the cursor's instance in one run, as a glyph and as a number."""
    if value is None:
        return
    y, theme = layout.row_of(index), canvas.theme
    row = model.rows[index]
    is_noted = row.sim_accuracy is None and row.real_accuracy is None
    if layout.chart_width and not is_noted:
        at = layout.column(value, model.axis)
        if canvas.char[y, at] not in (canvas.glyphs.sim, canvas.glyphs.real, canvas.glyphs.both):
            canvas.put(at, y, *canvas.options.role("cursor"), bold=True)
    if layout.cursor_numbers:
        canvas.text(canvas.width, y, f"{100 * value:.1f}", theme.cursor, align="right")


def _baseline(canvas: Canvas, column: int, layout: OverviewLayout) -> None:
    """The baseline between the rows of runs, where no line is drawn."""
    for y in range(layout.top, layout.top + layout.height):
        if (y - layout.top) % layout.step and canvas.char[y, column] == " ":
            canvas.put(column, y, canvas.glyphs.baseline, canvas.theme.truth)


def _mark(
    canvas: Canvas,
    rows: Sequence[OverviewRow],
    baseline: float | None,
    selected: int | None,
    lines: OverviewLines | None,
    mark: BrushShape,
) -> None:
    """A brushed range on a run's axis: highlighted background between bold ends."""
    panels = overview_panels(rows, baseline, selected, (canvas.width, canvas.height), lines)
    panel = next((panel for panel in panels if mark_on_panel(mark, panel.name)), None)
    if panel is None:
        return
    low, high = (int(panel.to_cells(end, 0.0)[0]) for end in mark_range(mark))
    canvas.fill(low, panel.y, high - low + 1, panel.height, canvas.theme.highlight)
    for y in range(panel.y, panel.y + panel.height):
        canvas.put(low, y, canvas.glyphs.scale_left, canvas.theme.truth, bold=True)
        canvas.put(high, y, canvas.glyphs.scale_right, canvas.theme.truth, bold=True)


def _axis(canvas: Canvas, y: int, model: OverviewModel, layout: OverviewLayout) -> None:
    theme, glyphs = canvas.theme, canvas.glyphs
    low, high = (100 * end for end in model.axis)
    end = layout.chart + layout.chart_width - 1
    canvas.hline(layout.chart, end, y, glyphs.horizontal, theme.faint)
    count = max(1, layout.chart_width // 8)
    width = tick_step(high - low, count)
    if model.baseline is not None:
        canvas.put(layout.column(model.baseline, model.axis), y, glyphs.baseline, theme.truth)
    free = layout.chart - 1
    for tick in tick_values(low, high, count):
        at = layout.column(tick / 100, model.axis)
        canvas.put(at, y, glyphs.tick, theme.muted)
        text = tick_text(tick, width)
        start = min(at - len(text) // 2, canvas.width - len(text))
        if start >= free:
            free = canvas.text(start, y + 1, text, theme.muted) + 1
