"""The history in cells: charts of the gap over the nights, with intervals and threshold."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from s2rstore.gap_history.gate_status import AxisStatus
from s2rstore.gap_history.reader import Night
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, RenderOptions, Rgb, Size, Theme
from s2rtui.charts.history.model import HEADLINE, HistoryModel, Track, history_model
from s2rtui.charts.shared.legend import LegendPart, draw_rows, fit_rows, legend_rows, text_part
from s2rtui.drawing.scale import short_number

LABELS = 5
"""Columns of numbers at the left."""
_FEWEST_ROWS, _WIDEST = 4, 8
_SIGNS: dict[AxisStatus, tuple[str, str]] = {
    "PASS": ("●", "o"),
    "FAIL": ("▲", "X"),
    "INCONCLUSIVE": ("○", "?"),
    "SKIPPED": ("·", "."),
}


@dataclass(frozen=True, slots=True)
class HistoryLayout:
    """First column and width of the charts, columns per day, and the rows of each chart.

    charts: (track, title row, first row, rows). hidden: tracks without room.
    """

    left: int
    width: int
    pitch: int
    charts: tuple[tuple[int, int, int, int], ...]
    hidden: tuple[int, ...]

    def column(self, day: int, model: HistoryModel) -> int:
        """The column of a night."""
        return self.left + (day - int(model.days[0])) * self.pitch + self.pitch // 2


def status_glyph(status: AxisStatus, options: RenderOptions) -> str:
    """The glyph of a status, readable without colours."""
    return _SIGNS[status][options.ascii]


def status_colour(status: AxisStatus, theme: Theme) -> Rgb:
    """The colour of a status."""
    return {"PASS": theme.sim, "FAIL": theme.real, "INCONCLUSIVE": theme.truth,
            "SKIPPED": theme.muted}[status]  # fmt: skip


def chart_columns(width: int) -> int:
    """The number of days that fit into `width` columns."""
    return max(1, width - (LABELS if width >= 24 else 0))


def history_layout(model: HistoryModel, size: Size, legend: int = 1) -> HistoryLayout:
    """Lay out the headline and as many axes as fit, those with the largest gaps first.

    `legend` rows are free below the dates.
    """
    width, height = max(1, size[0]), max(1, size[1])
    left = width - chart_columns(width)
    pitch = max(1, min(_WIDEST, (width - left) // max(1, model.span)))
    free = height - 1 - legend if height >= 6 else height
    fits = max(1, min(len(model.tracks), free // (_FEWEST_ROWS + 1)))
    last = [-math.inf if math.isnan(t.last.value) else t.last.value for t in model.tracks]
    ranked = sorted(range(1, len(model.tracks)), key=lambda index: -last[index])
    shown = [0, *sorted(ranked[: fits - 1])]
    charts, top = [], 0
    for place, index in enumerate(shown):
        rows = (free - top) // (len(shown) - place)
        title = 1 if rows > 1 else 0
        charts.append((index, top, top + title, max(1, rows - title)))
        top += rows
    hidden = tuple(sorted(set(range(len(model.tracks))) - set(shown)))
    return HistoryLayout(left, width - left, pitch, tuple(charts), hidden)


@dataclass(frozen=True, slots=True)
class ChartRows:
    """The rows of a chart: `count` rows from `top`, over a scale of G."""

    scale: tuple[float, float]
    top: int
    count: int

    def line(self, threshold: float) -> int:
        """The row of the threshold, with a row above and below it if there are three."""
        row = self._row(threshold)
        return row if self.count < 3 else min(max(row, self.top + 1), self.top + self.count - 2)

    def of(self, value: float, threshold: float) -> int:
        """The row of a G, clipped to the chart, and on the right side of the threshold's row if
        there are three rows.
        """
        row, line = self._row(value), self.line(threshold)
        if value == threshold or self.count < 3:
            return line if value == threshold else row
        return min(row, line - 1) if value > threshold else max(row, line + 1)

    def _row(self, value: float) -> int:
        share = (value - self.scale[0]) / (self.scale[1] - self.scale[0])
        return self.top + min(self.count - 1, max(0, math.floor((1 - share) * self.count)))


def draw_history(
    nights: Sequence[Night], size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    if not nights:
        canvas.text(0, 0, "no nights", options.theme.muted)
        return canvas
    model = history_model(nights, chart_columns(canvas.width))
    layout, legend = _layout_with_legend(model, canvas)
    for index, title, top, rows in layout.charts:
        track = model.tracks[index]
        if title < top:
            _title(canvas, title, track)
        chart = ChartRows(model.scale, top, rows)
        _threshold(canvas, model, layout, chart)
        _nights(canvas, model, layout, track, chart)
    if canvas.height >= 6:
        _dates(canvas, model, layout, canvas.height - 1 - len(legend))
        draw_rows(canvas, 0, canvas.height - len(legend), legend)
    return canvas


def _layout_with_legend(
    model: HistoryModel, canvas: Canvas
) -> tuple[HistoryLayout, list[list[LegendPart]]]:
    """The layout, and the rows of the legend, which names the tracks that have no room."""
    size, rows = (canvas.width, canvas.height), 1
    while True:
        layout = history_layout(model, size, rows)
        parts = _legend_parts(model, layout.hidden, canvas.options)
        legend = fit_rows(parts, canvas.width, most=max(1, legend_rows(canvas.height)))
        if len(legend) <= rows:
            return layout, legend
        rows = len(legend)


def _title(canvas: Canvas, row: int, track: Track) -> None:
    theme, status, gap = canvas.theme, track.statuses[-1], track.last
    free = canvas.text(0, row, track.name, theme.text, bold=track.name == HEADLINE) + 2
    free = _put_status(canvas, free, row, status)
    if not math.isnan(gap.value):
        bounds = f"{_short(gap.low)} .. {_short(gap.high)}"
        canvas.text(free, row, f"G {_short(gap.value)} ({bounds})", theme.text)


def _put_status(canvas: Canvas, x: int, row: int, status: AxisStatus) -> int:
    """Write glyph and name of a status; returns the column of the next text."""
    text = f"{status_glyph(status, canvas.options)} {status.lower()}"
    return canvas.text(x, row, text, status_colour(status, canvas.theme)) + 2


def _short(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}" if math.isfinite(value) else "?"


def _threshold(
    canvas: Canvas, model: HistoryModel, layout: HistoryLayout, chart: ChartRows
) -> None:
    """The line of the threshold, and the scale at the left."""
    theme = canvas.theme
    for day in range(int(model.days[0]), int(model.days[-1]) + 1):
        at = int(np.searchsorted(model.days, day, side="right")) - 1
        row = chart.line(float(model.thresholds[at]))
        start = layout.left + (day - int(model.days[0])) * layout.pitch
        canvas.hline(start, start + layout.pitch - 1, row, canvas.glyphs.horizontal, theme.truth)
    if not layout.left:
        return
    limit = float(model.thresholds[-1])
    marks = {chart.of(end, limit): (end, theme.muted) for end in (*model.scale, 0.0)}
    marks[chart.line(limit)] = (limit, theme.truth)
    for row, (value, colour) in marks.items():
        canvas.text(LABELS - 1, row, short_number(value, 2), colour, align="right")


def _nights(
    canvas: Canvas, model: HistoryModel, layout: HistoryLayout, track: Track, chart: ChartRows
) -> None:
    """Each night's interval as a line, its G as the glyph of its status."""
    for at, day in enumerate(model.days.tolist()):
        gap = float(track.value[at])
        if math.isnan(gap):
            continue
        column, colour = layout.column(day, model), status_colour(track.statuses[at], canvas.theme)
        limit = float(model.thresholds[at])
        ends = [
            chart.of(gap if math.isnan(end) else end, limit)
            for end in (float(track.low[at]), float(track.high[at]))
        ]
        canvas.vline(column, ends[1], ends[0], canvas.glyphs.vertical, colour)
        row = chart.of(gap, limit)
        canvas.put(column, row, status_glyph(track.statuses[at], canvas.options), colour, bold=True)
    _cuts(canvas, model, layout, track, chart)


def _cuts(
    canvas: Canvas, model: HistoryModel, layout: HistoryLayout, track: Track, chart: ChartRows
) -> None:
    """An arrow at the end of the scale that G or its interval exceeds, and the value of that G.

    The glyph of its status is next to the arrow, where it stays on its side of the threshold.
    Values are written from the newest night on, where the cells beside the arrow are free.
    """
    ends = {1: chart.top, -1: chart.top + chart.count - 1}
    cuts: list[tuple[int, int, float, Rgb]] = []
    for at, day in enumerate(model.days.tolist()):
        gap, column = float(track.value[at]), layout.column(day, model)
        colour = status_colour(track.statuses[at], canvas.theme)
        glyph, limit = status_glyph(track.statuses[at], canvas.options), float(model.thresholds[at])
        bounds = (gap, float(track.low[at]), float(track.high[at]))
        for end in {model.beyond(value) for value in bounds} - {0}:
            row, is_cut = ends[end], model.beyond(gap) == end
            beside = not is_cut and chart.of(gap, limit) == row
            if beside and layout.pitch == 1:
                continue
            arrow = cut_glyph(end, canvas.options)
            canvas.put(column + beside, row, arrow, colour, bold=True)
            if is_cut:
                cuts.append((column, row, gap, colour))
                if (chart.line(limit) - (row + end)) * end > 0:
                    canvas.put(column, row + end, glyph, colour, bold=True)
    used = {(column, row) for column, row, _, _ in cuts}
    for column, row, gap, colour in reversed(cuts):
        text = _short(gap)
        for start in (column + 1, column - len(text)):
            cells = {(place, row) for place in range(start - 1, start + len(text) + 1)}
            cells.discard((column, row))
            fits = layout.left <= start and start + len(text) <= layout.left + layout.width
            if fits and not cells & used:
                canvas.text(start, row, text, colour)
                used |= cells
                break


def cut_glyph(end: int, options: RenderOptions) -> str:
    """The glyph of a value above (1) or below (-1) the scale."""
    return options.glyphs.arrows[6 if end > 0 else 2]


def _dates(canvas: Canvas, model: HistoryModel, layout: HistoryLayout, row: int) -> None:
    """Dates below the nights: the newest always, others where there is room."""
    theme, free = canvas.theme, canvas.width
    for day in reversed(model.days.tolist()):
        date = datetime.date.fromordinal(day)
        text = f"{date:%Y-%m-%d}" if free == canvas.width else f"{date:%m-%d}"
        start = min(layout.column(day, model) - len(text) // 2, canvas.width - len(text))
        start = max(start, 0)
        if start + len(text) <= free - (0 if free == canvas.width else 2):
            canvas.text(start, row, text, theme.muted)
            free = start


def _legend_parts(
    model: HistoryModel, hidden: Sequence[int], options: RenderOptions
) -> list[LegendPart]:
    theme = options.theme
    statuses: tuple[AxisStatus, ...] = ("PASS", "FAIL", "INCONCLUSIVE")
    parts = []
    for status in statuses:
        text = f"{status_glyph(status, options)} {status.lower()}"
        parts.append(text_part(((text, status_colour(status, theme)),)))
    parts.append(text_part(((f"{options.glyphs.horizontal * 2} threshold", theme.truth),)))
    names = [model.tracks[index].name for index in hidden]
    notes = [f"no room for {', '.join(names)}"] if names else []
    if model.is_cut:
        arrows = "".join(cut_glyph(end, options) for end in (1, -1))
        notes.insert(0, f"{arrows} off scale")
    notes += [f"{model.older} older"] if model.older else []
    return [*parts, *(text_part(((note, theme.muted),)) for note in notes)]
