"""The shares in cells: a bar per factor with its interval, on one axis in metres."""

from __future__ import annotations

import math
import textwrap

from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, RenderOptions, Size
from s2rtui.charts.shares.model import (
    CONTRIBUTION,
    ShareBar,
    SharesInput,
    SharesModel,
    shares_model,
)
from s2rtui.drawing.scale import short_number, tick_step, tick_text, tick_values

_NAME = 19
"""Columns of the factors' names."""
_TEXT = 25
"""Columns of mean and interval where there is room for them beside the bars."""


def draw_shares(
    data: SharesInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS, note: str = ""
) -> Canvas:
    """The view in `size` (columns, rows); `note` says why nothing is shown."""
    canvas = Canvas(*size, options)
    model = shares_model(data)
    if model is None:
        for row, line in enumerate(textwrap.wrap(note, max(1, canvas.width))[: canvas.height]):
            canvas.text(0, row, line, canvas.theme.muted)
        return canvas
    beside = canvas.width >= _NAME + _TEXT + 20
    left, right = (_NAME, _TEXT + 1) if beside else (0, 0)
    width = max(1, canvas.width - left - right)
    step = 1 if beside else 2
    spaced = step + (canvas.height >= len(model.bars) * (step + 1) + 5)
    for number, bar in enumerate(model.bars):
        _draw_bar(canvas, model, bar, (left, number * spaced, width), beside)
    row = len(model.bars) * spaced
    _draw_axis(canvas, model, left, row, width)
    _draw_legend(canvas, model, row + 2)
    return canvas


def _draw_bar(
    canvas: Canvas, model: SharesModel, bar: ShareBar, place: tuple[int, int, int], beside: bool
) -> None:
    left, y, width = place
    theme, glyphs = canvas.theme, canvas.glyphs
    mean = bar.share.mean
    colour = theme.real if mean.value > 0 else theme.sim
    canvas.text(0, y, bar.factor, theme.text)
    if beside:
        canvas.text(left + width + 1, y, bar.text, theme.text)
    else:
        canvas.text(len(bar.factor) + 1, y, bar.text, theme.text)
        y += 1
    zero, end = (_column(model, value, left, width) for value in (0.0, mean.value))
    block = "#" if canvas.options.ascii else "█"
    for x in range(min(zero, end), max(zero, end) + 1):
        canvas.put(x, y, block, colour)
    if math.isfinite(mean.low):
        low, high = (_column(model, value, left, width) for value in (mean.low, mean.high))
        is_cut = mean.low < model.scale[0], mean.high > model.scale[1]
        line = "-" if canvas.options.ascii else "─"
        for x in range(low, high + 1):
            if not min(zero, end) <= x <= max(zero, end):
                canvas.put(x, y, line, theme.text)
        for at, glyph, is_beyond in ((low, "<", is_cut[0]), (high, ">", is_cut[1])):
            if is_beyond:
                canvas.put(at, y, glyph, theme.text, bold=True)
    overall = _column(model, bar.overall, left, width)
    canvas.put(overall, y, glyphs.truth, theme.truth, bold=True)


def _draw_axis(canvas: Canvas, model: SharesModel, left: int, y: int, width: int) -> None:
    low, high = model.scale
    step = tick_step(high - low, max(1, width // 10))
    free = left
    for tick in tick_values(low, high, max(1, width // 10)):
        text = tick_text(tick, step) if step < 1e4 else short_number(tick)
        start = _column(model, tick, left, width)
        if start >= free and start + len(text) <= left + width - 2:
            free = canvas.text(start, y, text, canvas.theme.muted) + 1
    canvas.text(left + width - 1, y, "m", canvas.theme.muted)


def _draw_legend(canvas: Canvas, model: SharesModel, y: int) -> None:
    lines = [
        f"{model.counted}; > 0 makes real errors larger than sim errors",
        f"{canvas.glyphs.truth} all instances; lines: 95 % intervals for all factors at once",
        CONTRIBUTION,
    ]
    wrapped = [part for line in lines for part in textwrap.wrap(line, max(10, canvas.width))]
    for row, line in enumerate(wrapped):
        if y + row < canvas.height:
            canvas.text(0, y + row, line, canvas.theme.muted)


def _column(model: SharesModel, value: float, left: int, width: int) -> int:
    low, high = model.scale
    share = (value - low) / (high - low)
    return left + min(max(int(share * width), 0), width - 1)
