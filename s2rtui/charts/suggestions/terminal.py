"""The suggestions in cells: a line per answer with its gain and interval, the chosen one lit."""

from __future__ import annotations

import math

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, Panel, RenderOptions, Size
from s2rtui.charts.shared.line_panel import line_panels
from s2rtui.charts.suggestions.lines import Line, suggestion_lines
from s2rtui.charts.suggestions.model import Direction, SuggestionsInput, gain_scale
from s2rtui.drawing.scale import tick_step, tick_text, tick_values

_GUTTER = 2
_TICKS = 12
"""Columns for each tick of the axis."""


def legend(options: RenderOptions) -> str:
    """What the marks mean."""
    glyphs = options.glyphs
    return (
        "* suggested, ? not shown to help (its interval holds 0); "
        f"{glyphs.selected} gain on held-out instances with its interval, {glyphs.vertical} 0, "
        f"{glyphs.baseline} price of the changes"
    )


def _window(data: SuggestionsInput, size: Size, options: RenderOptions) -> tuple[list[Line], int]:
    """The lines, and the first visible one; the chosen answer is visible."""
    width, height = max(1, size[0] - _GUTTER), max(1, size[1])
    lines = suggestion_lines(data, width, height, legend(options))
    chosen = data.chosen_index
    places = [at for at, line in enumerate(lines) if line.index == chosen and chosen is not None]
    if len(lines) <= height or not places:
        return lines, 0
    return lines, max(0, min(places[-1] - height + 1, places[0]))


def draw_suggestions(
    data: SuggestionsInput,
    size: Size,
    options: RenderOptions = DEFAULT_OPTIONS,
    active: bool = True,
) -> Canvas:
    """The view in `size` (columns, rows); `active`: whether the chosen answer is highlighted."""
    canvas = Canvas(*size, options)
    theme, glyphs = options.theme, options.glyphs
    lines, first = _window(data, (canvas.width, canvas.height), options)
    is_marked = False
    for y, line in enumerate(lines[first : first + canvas.height]):
        if active and line.index is not None and line.index == data.chosen_index:
            canvas.fill(0, y, canvas.width, 1, theme.highlight)
            if not is_marked:
                canvas.put(0, y, glyphs.pointer, theme.truth, bold=True)
                is_marked = True
        ink = theme.muted if line.style == "muted" else theme.text
        if line.style == "heading" and line.direction is not None:
            ink = theme.real if line.direction.side == "real" else theme.sim
        bold = line.style in ("heading", "bold")
        canvas.text(_GUTTER, y, options.printable(line.text), ink, bold=bold)
        if line.direction is not None and line.drawn is not None:
            left = _GUTTER + line.start
            if canvas.width - left >= 2:
                _draw_gain(canvas, line.direction, line.drawn, (left, y, canvas.width - left))
    return canvas


def _draw_gain(
    canvas: Canvas, direction: Direction, number: int, place: tuple[int, int, int]
) -> None:
    """Draw the gain of an answer in its row, or the axis below all answers (`number` -1)."""
    left, y, width = place
    assert direction.report is not None
    report, theme, glyphs = direction.report, canvas.theme, canvas.glyphs
    low, high = scale = gain_scale(report)

    def column(value: float) -> int:
        share = (value - scale[0]) / (scale[1] - scale[0])
        return left + min(int(min(max(share, 0.0), 1.0) * width), width - 1)

    if number < 0:
        factor, unit = (1.0, "m") if report.side == "real" else (100.0, "%")
        count = max(1, width // _TICKS)
        step, free = tick_step(factor * (high - low), count), left
        for tick in tick_values(factor * low, factor * high, count):
            text = tick_text(tick, step)
            start = column(tick / factor)
            if start >= free and start + len(text) < left + width - 1:
                free = canvas.text(start, y, text, theme.muted) + 1
        canvas.text(left + width - 1, y, unit, theme.muted)
        return
    answer = direction.answers[number]
    gain = answer.gain
    ink = theme.real if report.side == "real" else theme.sim
    if math.isfinite(gain.low) and math.isfinite(gain.high):
        ends = column(gain.low), column(gain.high)
        canvas.hline(*ends, y, glyphs.interval, ink)
        for at, end, mark in zip(ends, (gain.low, gain.high), "<>", strict=True):
            if not low <= end <= high:
                canvas.put(at, y, mark, theme.text, bold=True)
    canvas.put(column(0.0), y, glyphs.vertical, theme.muted)
    price = len(answer.changes) * report.price_of_a_change
    if math.isfinite(price):
        canvas.put(column(price), y, glyphs.baseline, theme.text)
    if math.isfinite(gain.value):
        mark = glyphs.selected if answer.evident else glyphs.trained
        canvas.put(column(gain.value), y, mark, ink, bold=True)


def suggestions_panels(
    data: SuggestionsInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> tuple[Panel, ...]:
    """One panel; y is the place of an answer, -1 for other lines."""
    lines, first = _window(data, size, options)
    return line_panels("suggestions", [line.index for line in lines], first, size)
