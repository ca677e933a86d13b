"""The recall in cells: a curve per side over a logarithmic axis, and the figures below."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.recall import RecallCurve
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, RenderOptions, Rgb, Size
from s2rtui.canvas.raster import dot_grid, draw_braille
from s2rtui.charts.recall.model import RecallModel

_LEFT = 6
"""Columns of the shares beside the curves."""
_FEWEST_ROWS = 5
_NAME = 16
_COLUMN = 24
"""Columns of a figure with its interval."""


def draw_recall(model: RecallModel, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    notes = [model.counted, *([model.reason] if model.reason else [])]
    below = len(model.rows()) + 1 + len(notes)
    rows = canvas.height - below - 2
    if rows < _FEWEST_ROWS:
        rows = -2
    else:
        _draw_plot(canvas, model, rows)
    _draw_table(canvas, model, rows + 2, notes)
    return canvas


def _draw_plot(canvas: Canvas, model: RecallModel, rows: int) -> None:
    theme, width = canvas.theme, max(2, canvas.width - _LEFT)
    for share in (100, 50, 0):
        canvas.text(_LEFT - 1, _row(share / 100, rows), f"{share} %", theme.muted, align="right")
    points = model.real.figures.points
    columns = [_LEFT + int(model.fractions(np.array(p.metres)) * width) for p in points]
    free = _LEFT
    for point, column in zip(points, columns, strict=True):
        canvas.vline(column, 0, rows - 1, canvas.glyphs.vertical, theme.unselected)
        text = f"{point.metres:g} m"
        if column - len(text) // 2 >= free:
            free = canvas.text(column, rows, text, theme.muted, align="center") + 1
    fitting = [text for text in model.axis_names if free + len(text) < canvas.width]
    canvas.text(canvas.width, rows, fitting[0] if fitting else "", theme.muted, align="right")
    for _, side in model.sides:
        if side.everything is not None:
            _draw_curve(canvas, model, side.everything, rows, theme.unselected, ".")
    for name, side in model.sides:
        glyph, colour = canvas.options.role(name)
        _draw_curve(canvas, model, side.curve, rows, colour, glyph)
    for name, side in model.sides:
        glyph, colour = canvas.options.role(name)
        for point, column in zip(side.figures.points, columns, strict=True):
            if point.share.value == point.share.value:
                canvas.put(column, _row(point.share.value, rows), glyph, colour, bold=True)


def _draw_curve(
    canvas: Canvas, model: RecallModel, curve: RecallCurve, rows: int, colour: Rgb, glyph: str
) -> None:
    """A line of dots; in ASCII a glyph in every second column."""
    if not curve.limits.size:
        return
    width = max(2, canvas.width - _LEFT)
    fractions = (np.arange(2 * width) + 0.5) / (2 * width)
    shares = curve.at(model.metres(fractions))
    if canvas.options.ascii:
        for column in range(0, width, 2):
            canvas.put(_LEFT + column, _row(float(shares[2 * column]), rows), glyph, colour)
        return
    heights = (1 - shares) * (rows - 1) + 0.5
    steps: NDArray[np.float64] = np.linspace(0, 1, 4 * rows)[:, None]
    joined = heights[:-1] + (heights[1:] - heights[:-1]) * steps
    across = np.broadcast_to(_LEFT + fractions[1:] * width, joined.shape)
    dots = dot_grid(across.ravel(), joined.ravel(), canvas.width, rows)
    draw_braille(canvas, dots, colour)


def _row(share: float, rows: int) -> int:
    return round((1 - share) * (rows - 1))


def _draw_table(canvas: Canvas, model: RecallModel, top: int, notes: list[str]) -> None:
    """The figures of both sides, with intervals where they fit."""
    theme = canvas.theme
    wide = canvas.width >= _NAME + 2 * _COLUMN
    step = _COLUMN if wide else max(8, (canvas.width - _NAME) // 2)
    for place, (name, _) in enumerate(model.sides):
        glyph, colour = canvas.options.role(name)
        canvas.text(_NAME + place * step, top, f"{glyph} {name}", colour)
    for row, (name, sim, sim_bounds, real, real_bounds) in enumerate(model.rows(), start=top + 1):
        canvas.text(0, row, name, theme.muted)
        for place, (value, bounds) in enumerate(((sim, sim_bounds), (real, real_bounds))):
            end = canvas.text(_NAME + place * step, row, value, theme.text)
            if wide and bounds:
                canvas.text(end + 1, row, f"({bounds})", theme.muted)
    for row, note in enumerate(notes, start=top + 1 + len(model.rows())):
        canvas.text(0, row, note, theme.muted)
