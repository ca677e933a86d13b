"""The history on paper: a chart of the overall gap and one per axis, on one scale."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.gap_history.gate_status import AxisStatus
from s2rstore.gap_history.reader import Night
from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.history.model import HEADLINE, HistoryModel, Track, history_model
from s2rtui.charts.history.terminal import status_colour
from s2rtui.drawing.page import (
    NARROW,
    Ink,
    Page,
    Pixels,
    new_page,
    own_settings,
    rgb_fractions,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_DAYS = 120
_MARKERS: dict[AxisStatus, str] = {"PASS": "o", "FAIL": "^", "INCONCLUSIVE": "s", "SKIPPED": "."}
_LEGEND = "● pass   ▲ fail   ■ inconclusive   - - threshold"
DATE = 0.9
"""Inches that a date takes."""
_CUT = "↑ ↓ off scale"
_LEFT, _BOTTOM, _BETWEEN = 0.7, 0.65, 0.32


@own_settings()
def history_figure(
    nights: Sequence[Night], size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw at least one night in `size` pixels."""
    page = new_page(size, theme, title, subtitle)
    model = history_model(nights, MOST_DAYS)
    count = len(model.tracks)
    is_narrow = page.inches[0] <= NARROW
    bottom = _BOTTOM + (0.3 if is_narrow else 0.0)
    height = max(0.2, (page.top - 0.25 - bottom - (count - 1) * _BETWEEN) / count)
    for index, track in enumerate(model.tracks):
        foot = bottom + (count - 1 - index) * (height + _BETWEEN)
        axes = page.axes(_LEFT, foot, page.inches[0] - _LEFT - 0.25, height)
        _draw_track(axes, model, track, page)
        _set_dates(axes, model, index == count - 1, page.inches[0] - _LEFT - 0.25)
        if index == 0 and not is_narrow:
            legend = f"{_LEGEND}   {_CUT}" if model.is_cut else _LEGEND
            axes.set_title(legend, loc="right", fontsize=8.5, pad=4, color=page.inks.muted)
    middle = (bottom + page.top - 0.25) / 2
    style = {"ha": "center", "va": "center", "rotation": 90}
    page.text(0.2, middle, "gap G (no unit)", page.inks.muted, 9, **style)
    if is_narrow:
        page.text(0.25, 0.32, _LEGEND, page.inks.muted, 7)
        page.text(0.25, 0.16, _CUT if model.is_cut else "", page.inks.muted, 7)
    return page.encoded()


def _draw_track(axes: Axes, model: HistoryModel, track: Track, page: Page) -> None:
    inks, days = page.inks, model.days
    style_axes(axes, page)
    low, high = model.scale
    margin = 0.06 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(days[0] - 0.6, days[-1] + 0.6)
    ends = np.concatenate([[days[0] - 0.6], days, [days[-1] + 0.6]])
    limits = np.concatenate([model.thresholds[:1], model.thresholds, model.thresholds[-1:]])
    dashed = (0, (4, 3))
    axes.plot(
        ends, limits, color=inks.truth, linewidth=1.1, linestyle=dashed, drawstyle="steps-mid"
    )
    for at, day in enumerate(days):
        ink = rgb_fractions(status_colour(track.statuses[at], page.theme))
        value, *bounds = np.clip([track.value[at], track.low[at], track.high[at]], low, high)
        if not math.isnan(value):
            axes.plot([day, day], bounds, color=ink, linewidth=1.6, solid_capstyle="butt")
            axes.plot(
                [day], [value], marker=_MARKERS[track.statuses[at]], markersize=5.5, color=ink
            )
            _draw_cuts(axes, model, track, at, ink)
    weight = "bold" if track.name == HEADLINE else "normal"
    axes.set_title(track.name, loc="left", fontsize=9.5, pad=4, color=inks.text, fontweight=weight)


def _draw_cuts(axes: Axes, model: HistoryModel, track: Track, at: int, ink: Ink) -> None:
    """Write an arrow at the end of the scale that G or its interval exceeds, with that G."""
    day, gap = int(model.days[at]), float(track.value[at])
    sign, align = (-1, "right") if at == len(model.days) - 1 else (1, "left")
    for end in {model.beyond(part) for part in (gap, track.low[at], track.high[at])} - {0}:
        arrow = "↑" if end > 0 else "↓"
        text = f"{arrow} {gap:.1f}".replace("-", "−") if model.beyond(gap) == end else arrow
        axes.annotate(
            text, (day, model.scale[end > 0]), xytext=(6 * sign, 0), textcoords="offset points",
            ha=align, va="center", fontsize=8.5, color=ink, zorder=6,
        )  # fmt: skip


def _set_dates(axes: Axes, model: HistoryModel, labelled: bool, inches: float) -> None:
    """About ten dates on an axis of `inches`, fewer if it is short, with the newest one."""
    step = -(-model.span // max(1, min(10, int(inches / DATE))))
    ticks = list(range(int(model.days[-1]), int(model.days[0]) - 1, -step))
    dates = [f"{datetime.date.fromordinal(day):%Y-%m-%d}" for day in ticks]
    axes.set_xticks(ticks, dates if labelled else [""] * len(ticks))
