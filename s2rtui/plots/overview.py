"""The overview: a line per run, sim and real accuracy as marks with the gap between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rich.cells import cell_len, set_cell_size

from s2rtui.canvas.grid import Canvas, Size
from s2rtui.canvas.look import Look
from s2rtui.plots.inputs import Interval, OverviewRow
from s2rtui.plots.scale import finite, step, tick_text, ticks

NUMBERS = 12
"""Columns that the two numbers at the right take."""


@dataclass(frozen=True, slots=True)
class OverviewModel:
    """Rows with NaN turned into None, and the axis (accuracies) that holds them all."""

    rows: tuple[OverviewRow, ...]
    baseline: float | None
    axis: Interval


def overview_model(rows: Sequence[OverviewRow], baseline: float | None = None) -> OverviewModel:
    """The cleaned rows; the axis is rounded outwards and stays within what accuracies can be."""
    clean = tuple(
        OverviewRow(
            row.run,
            finite(row.sim_accuracy),
            finite(row.real_accuracy),
            _interval(row.sim_interval),
            _interval(row.real_interval),
            row.n,
            row.note,
        )
        for row in rows
    )
    seen = [finite(baseline)]
    for row in clean:
        seen += [row.sim_accuracy, row.real_accuracy]
        seen += [*(row.sim_interval or ()), *(row.real_interval or ())]
    values = [value for value in seen if value is not None]
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    width = step(max(high - low, 0.02), 4)
    low, high = math.floor(low / width + 1e-9) * width, math.ceil(high / width - 1e-9) * width
    if high <= low:
        high = low + width
    return OverviewModel(clean, finite(baseline), (max(0.0, low), min(max(1.0, low + width), high)))


def _interval(interval: Interval | None) -> Interval | None:
    if interval is None:
        return None
    low, high = finite(interval[0]), finite(interval[1])
    return None if low is None or high is None else (min(low, high), max(low, high))


@dataclass(frozen=True, slots=True)
class OverviewLayout:
    """Where the parts stand: columns of name, chart and numbers; rows of the runs."""

    name: int
    chart: int
    chart_width: int
    numbers: int
    top: int
    first: int
    shown: int
    axis_rows: int

    def run_at(self, y: int) -> int | None:
        """The index of the run drawn on row `y`."""
        index = y - self.top
        return self.first + index if 0 <= index < self.shown else None


def overview_layout(
    rows: Sequence[OverviewRow], selected: int | None, size: Size
) -> OverviewLayout:
    """Room for each part; the window of runs follows `selected` where not all fit."""
    width, height = size
    longest = max((cell_len(row.run) for row in rows), default=0)
    numbers = NUMBERS if width >= 24 else 0
    name = max(0, min(longest, 24, (width - numbers) // 3))
    chart_width = max(0, width - 2 - name - 1 - numbers)
    if chart_width < 8:
        name, chart_width = max(0, width - 2 - numbers), 0
    top = 1 if height >= 4 else 0
    axis_rows = 0 if height < 5 or chart_width == 0 else 2
    space = max(1, height - top - axis_rows)
    shown = min(len(rows), space)
    first = 0
    if selected is not None and len(rows) > space:
        first = min(max(0, selected - space // 2), len(rows) - space)
    return OverviewLayout(
        name, name + 3, chart_width, width - numbers, top, first, shown, axis_rows
    )


def overview(
    rows: Sequence[OverviewRow],
    baseline: float | None,
    selected: int | None,
    size: Size,
    look: Look | None = None,
) -> Canvas:
    """The view in `size` (columns, rows); `selected` is an index into `rows`."""
    look = look or Look()
    canvas = Canvas(*size, theme=look.theme)
    model = overview_model(rows, baseline)
    layout = overview_layout(model.rows, selected, (canvas.width, canvas.height))
    if not rows:
        canvas.text(0, 0, "no run has been computed", look.theme.muted)
        return canvas
    if layout.top:
        _header(canvas, layout, look)
    for index in range(layout.first, layout.first + layout.shown):
        y = layout.top + index - layout.first
        if index == selected:
            canvas.fill(0, y, canvas.width, 1, look.theme.highlight)
            canvas.put(0, y, look.glyphs.pointer, look.theme.text, bold=True)
        _line(canvas, y, model, index, layout, look, index == selected)
    if layout.axis_rows:
        _axis(canvas, layout.top + layout.shown, model, layout, look)
    return canvas


def _column(value: float, model: OverviewModel, layout: OverviewLayout) -> int:
    low, high = model.axis
    place = (value - low) / (high - low) * (layout.chart_width - 1)
    return layout.chart + min(layout.chart_width - 1, max(0, round(place)))


def _header(canvas: Canvas, layout: OverviewLayout, look: Look) -> None:
    theme, glyphs = look.theme, look.glyphs
    canvas.text(2, 0, set_cell_size("run", min(layout.name, 3)), theme.muted)
    if layout.chart_width:
        wide = layout.chart_width >= 24
        canvas.text(
            layout.chart, 0, "accuracy %" if wide else "acc. %"[: layout.chart_width], theme.muted
        )
        if wide:
            canvas.text(
                layout.chart + 12,
                0,
                f"{glyphs.baseline} baseline"[: layout.chart_width - 12],
                theme.muted,
            )
    if layout.numbers < canvas.width:
        canvas.text(layout.numbers + 5, 0, f"{glyphs.sim} sim", theme.sim, align="right")
        canvas.text(layout.numbers + 12, 0, f"{glyphs.real} real", theme.real, align="right")


def _line(
    canvas: Canvas,
    y: int,
    model: OverviewModel,
    index: int,
    layout: OverviewLayout,
    look: Look,
    bold: bool,
) -> None:
    row, theme = model.rows[index], look.theme
    name = row.run
    if cell_len(name) > layout.name:
        name = set_cell_size(name, max(0, layout.name - 1)) + look.glyphs.ellipsis
    if look.ascii:
        name = name.encode("ascii", "replace").decode()
    canvas.text(2, y, name if layout.name else "", theme.text, bold=bold)
    if layout.chart_width:
        _marks(canvas, y, model, row, layout, look)
    if layout.numbers < canvas.width:
        for value, right, colour in (
            (row.sim_accuracy, 5, theme.sim),
            (row.real_accuracy, 12, theme.real),
        ):
            text = "n/a" if value is None else f"{100 * value:.1f}"
            shade = theme.muted if value is None else colour
            canvas.text(layout.numbers + right, y, text, shade, bold=bold, align="right")


def _marks(
    canvas: Canvas,
    y: int,
    model: OverviewModel,
    row: OverviewRow,
    layout: OverviewLayout,
    look: Look,
) -> None:
    theme, glyphs = look.theme, look.glyphs
    sides = (
        (row.sim_accuracy, row.sim_interval, theme.sim, glyphs.sim),
        (row.real_accuracy, row.real_interval, theme.real, glyphs.real),
    )
    for _, interval, colour, _ in sides:
        if interval is not None:
            ends = [_column(value, model, layout) for value in interval]
            canvas.hline(ends[0], ends[1], y, glyphs.interval, colour)
    places = [None if value is None else _column(value, model, layout) for value, *_ in sides]
    sim, real = places
    if sim is not None and real is not None and abs(sim - real) > 1:
        low, high = sorted((sim, real))
        worse = row.real_accuracy is not None and row.sim_accuracy is not None
        worse = worse and (row.real_accuracy or 0.0) < (row.sim_accuracy or 0.0)
        canvas.hline(low + 1, high - 1, y, glyphs.bar, theme.muted if worse else theme.truth)
    if model.baseline is not None:
        at = _column(model.baseline, model, layout)
        canvas.put(at, y, glyphs.baseline, theme.truth)
    if sim is not None and sim == real:
        canvas.put(sim, y, glyphs.both, theme.text, bold=True)
        return
    for place, (_, _, colour, glyph) in zip(places, sides, strict=True):
        if place is not None:
            canvas.put(place, y, glyph, colour, bold=True)
    if sim is None and real is None:
        canvas.text(layout.chart, y, (row.note or "n/a")[: layout.chart_width], theme.muted)


def _axis(canvas: Canvas, y: int, model: OverviewModel, layout: OverviewLayout, look: Look) -> None:
    theme, glyphs = look.theme, look.glyphs
    low, high = (100 * end for end in model.axis)
    end = layout.chart + layout.chart_width - 1
    canvas.hline(layout.chart, end, y, glyphs.horizontal, theme.faint)
    count = max(1, layout.chart_width // 8)
    width = step(high - low, count)
    if model.baseline is not None:
        canvas.put(_column(model.baseline, model, layout), y, glyphs.baseline, theme.truth)
    free = layout.chart - 1
    for tick in ticks(low, high, count):
        at = _column(tick / 100, model, layout)
        canvas.put(at, y, glyphs.tick, theme.muted)
        text = tick_text(tick, width)
        start = min(at - len(text) // 2, canvas.width - len(text))
        if start >= free:
            free = canvas.text(start, y + 1, text, theme.muted) + 1
