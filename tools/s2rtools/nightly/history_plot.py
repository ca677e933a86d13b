"""Plot of the history: G of the headline and of every axis over the nights."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Sequence
from io import BytesIO
from typing import TYPE_CHECKING

from s2rstore.gap_history.gate_status import axis_status
from s2rstore.gap_history.reader import Night
from s2rstore.intervals import Interval
from s2rtools.nightly.report_model import NightReport

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GROUND, TEXT, MUTED, FAINT, LIMIT = "#fafaf8", "#1c212a", "#626a78", "#ced2d9", "#b07a00"
MARKS = {"PASS": ("o", "#1d5fce"), "FAIL": ("^", "#d02c30"), "INCONCLUSIVE": ("s", "#8a6000")}
_SETTINGS = {"font.family": "DejaVu Sans", "savefig.bbox": None, "text.parse_math": False}
_WIDE, _PANEL, _DPI = 9.6, 1.5, 125
_MIN_G, _MAX_G = -20.0, 120.0
"""Limits of the displayed G."""

Panel = tuple[str, Callable[[Night], Interval], Callable[[Night], str]]


def history_plot(report: NightReport) -> bytes:
    """A PNG; the same nights give the same bytes."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = _panels(report)
    high = 0.7 + _PANEL * len(panels)
    with rc_context(_SETTINGS):
        figure = Figure(figsize=(_WIDE, high), dpi=_DPI, facecolor=GROUND)
        FigureCanvasAgg(figure)
        grid = figure.subplots(len(panels), 1, sharex=True, sharey=True, squeeze=False)
        figure.subplots_adjust(0.065, 0.42 / high, 0.985, 1 - 0.36 / high, hspace=0.42)
        rows = list(grid[:, 0])
        for axes, panel in zip(rows, panels, strict=True):
            _draw_panel(axes, report.past, panel)
        _set_scale(rows, report, panels)
        stream = BytesIO()
        figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    return stream.getvalue()


def _panels(report: NightReport) -> list[Panel]:
    def axis_panel(axis: str) -> Panel:
        def gap(night: Night) -> Interval:
            gaps = (each.gap for each in night.axes if each.axis == axis)
            return next(gaps, Interval.unknown())

        return axis, gap, lambda night: axis_status(gap(night), night.threshold)

    headline: Panel = ("headline", lambda night: night.gap, lambda night: night.headline)
    return [headline, *map(axis_panel, report.axis_names())]


def _draw_panel(axes: Axes, past: tuple[Night, ...], panel: Panel) -> None:
    name, gap_of, status_of = panel
    days = [night.night.toordinal() for night in past]
    steps = [night.threshold for night in past]
    axes.plot([days[0] - 0.5, *days, days[-1] + 0.5], [steps[0], *steps, steps[-1]], color=LIMIT,
              linewidth=1.1, linestyle=(0, (4, 3)), drawstyle="steps-mid")  # fmt: skip
    for day, night in zip(days, past, strict=True):
        gap, (marker, ink) = gap_of(night), MARKS.get(status_of(night), ("o", MUTED))
        value, low, high = (min(max(x, _MIN_G), _MAX_G) for x in (gap.value, gap.low, gap.high))
        if math.isfinite(gap.value):
            axes.plot([day, day], [low, high], color=ink, linewidth=1.6, solid_capstyle="butt")
            axes.plot([day], [value], marker=marker, markersize=5.5, color=ink)
    axes.set_title(f"{name}, G", loc="left", fontsize=9.5, color=TEXT, pad=4)
    axes.set_facecolor(GROUND)
    axes.tick_params(colors=MUTED, labelsize=8, length=3)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(FAINT)


def _set_scale(rows: Sequence[Axes], report: NightReport, panels: list[Panel]) -> None:
    """One scale for all panels, because G is comparable between axes."""
    gaps = [gap_of(night) for _, gap_of, _ in panels for night in report.past]
    values = [x for gap in gaps for x in (gap.value, gap.low, gap.high) if math.isfinite(x)]
    top = max([*values, 1.6 * report.night.threshold])
    bottom = min([*values, 0.0])
    low, high = max(bottom, _MIN_G), min(top, _MAX_G)
    rows[0].set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    days = [night.night.toordinal() for night in report.past]
    rows[0].set_xlim(days[0] - 0.6, days[-1] + 0.6)
    step = max(1, -(-(days[-1] - days[0] + 1) // 10))
    ticks = list(range(days[-1], days[0] - 1, -step))[::-1]
    dates = [datetime.date.fromordinal(tick).strftime("%d %b") for tick in ticks]
    rows[-1].set_xticks(ticks, dates)
    legend = "● pass   ▲ fail   ■ inconclusive   - - threshold"
    rows[0].set_title(legend, loc="right", fontsize=8.5, color=MUTED, pad=4)
