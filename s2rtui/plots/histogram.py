"""The error histogram: sim above real, the selected part lit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas.colour import ColourMode, Rgb
from s2rtui.canvas.grid import Canvas, Size
from s2rtui.canvas.look import Look
from s2rtui.plots.inputs import HistogramInput
from s2rtui.plots.scale import short, step, tick_text, ticks

EIGHTHS = " ▁▂▃▄▅▆▇█"
Counts = NDArray[np.intp]
LABELS = 9
"""Columns at the left that the names take."""


@dataclass(frozen=True, slots=True, eq=False)
class HistogramModel:
    """edges: (bins + 1,), from 0. Counts per side, (bins,): all valid, and the selected of them.

    What lies beyond the last edge counts into the last bin.
    """

    edges: NDArray[np.float64]
    sim: tuple[Counts, Counts]
    real: tuple[Counts, Counts]


def histogram_model(view: HistogramInput, bins: int) -> HistogramModel:
    """Both sides over one range: 0 to `upper`, by default the 99th percentile of both."""
    valid = np.asarray(view.valid, dtype=np.bool_)
    both = np.concatenate([np.asarray(view.sim)[valid], np.asarray(view.real)[valid]])
    both = both[np.isfinite(both)]
    upper = view.upper
    if upper is None:
        upper = float(np.percentile(both, 99)) if both.size else 1.0
    upper = upper if upper > 0 else 1.0
    count = max(1, bins)

    def counts(errors: NDArray[np.floating]) -> tuple[Counts, Counts]:
        errors = np.asarray(errors, dtype=np.float64)
        good = valid & np.isfinite(errors)
        index = np.clip(np.where(good, errors, 0) / upper * count, 0, count - 1).astype(np.intp)
        lit = good & np.asarray(view.selected, dtype=np.bool_)
        return (
            np.bincount(index[good], minlength=count),
            np.bincount(index[lit], minlength=count),
        )

    edges = np.linspace(0.0, upper, count + 1)
    return HistogramModel(edges, counts(view.sim), counts(view.real))


def histogram(view: HistogramInput, size: Size, look: Look | None = None) -> Canvas:
    """The view in `size` (columns, rows): two rows of bars over one axis."""
    look = look or Look()
    canvas = Canvas(*size, theme=look.theme)
    theme, glyphs = look.theme, look.glyphs
    left = LABELS if canvas.width >= 20 else 0
    model = histogram_model(view, canvas.width - left)
    axis = 1 if canvas.height >= 5 else 0
    upper = max(1, (canvas.height - axis + 1) // 2)
    lower = max(0, canvas.height - axis - upper)
    peak = int(max(model.sim[0].max(), model.real[0].max(), 1))
    for top, rows, counts, glyph, name, colour in (
        (0, upper, model.sim, glyphs.sim, "sim", theme.sim),
        (upper, lower, model.real, glyphs.real, "real", theme.real),
    ):
        _bars(canvas, left, top, rows, counts, peak, colour, look)
        if left and rows:
            canvas.text(0, top, f"{glyph} {name}", colour)
            if rows > 1:
                canvas.text(0, top + 1, _most(int(counts[0].max())), theme.muted)
    if axis:
        _axis(canvas, left, model, view, look)
    return canvas


def _most(count: int) -> str:
    return f"max {count}" if count < 10_000 else f"max {count // 1000}k"


def _bars(
    canvas: Canvas,
    x: int,
    y: int,
    rows: int,
    counts: tuple[Counts, Counts],
    peak: int,
    colour: Rgb,
    look: Look,
) -> None:
    """Bars upwards from the last of `rows`; the unselected part grey above the selected one."""
    total, lit = (np.ceil(part / peak * rows * 8).astype(np.intp) for part in counts)
    theme = look.theme
    for row in range(rows):
        level = (rows - 1 - row) * 8
        for column in np.flatnonzero(total > level).tolist():
            whole = int(min(8, total[column] - level))
            part = int(np.clip(lit[column] - level, 0, 8))
            if look.ascii or look.mode is ColourMode.NONE:
                glyph = ".#"[2 * part >= whole] if look.ascii else "░█"[2 * part >= whole]
                canvas.put(x + column, y + row, glyph, colour if part else theme.unselected)
            elif part == 0:
                canvas.put(x + column, y + row, EIGHTHS[whole], theme.unselected)
            elif part == 8 or part == whole:
                canvas.put(x + column, y + row, EIGHTHS[part], colour)
            else:
                ground = theme.unselected if whole == 8 else None
                canvas.put(x + column, y + row, EIGHTHS[part], colour, ground)


def _axis(
    canvas: Canvas, left: int, model: HistogramModel, view: HistogramInput, look: Look
) -> None:
    upper, row = float(model.edges[-1]), canvas.height - 1
    chart = canvas.width - left
    count = max(1, chart // 8)
    width = step(upper, count)
    name = f"{view.label} {view.unit}".strip()
    stop = canvas.width - len(name) - 1
    free = left
    for tick in ticks(0.0, upper, count):
        text = tick_text(tick, width) if width < 1e4 else short(tick)
        start = left + min(chart - 1, int(tick / upper * chart))
        if start >= free and start + len(text) <= stop:
            free = canvas.text(start, row, text, look.theme.muted) + 1
    if stop > left:
        canvas.text(canvas.width - len(name), row, name, look.theme.muted)
