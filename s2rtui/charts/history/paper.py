"""The history on paper: a chart of the overall gap and one per axis, on one scale."""

from __future__ import annotations

import datetime
import math
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.gap_history.gate_status import AxisStatus
from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.history.model import HEADLINE, HistoryInput, HistoryModel, Track, history_model
from s2rtui.charts.history.terminal import status_colour
from s2rtui.charts.shared.paper import (
    Page,
    Pixels,
    draw_heading,
    figure_bytes,
    make_page,
    new_figure,
    rgb_fractions,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_DAYS = 120
_MARKERS: dict[AxisStatus, str] = {"PASS": "o", "FAIL": "^", "INCONCLUSIVE": "s", "SKIPPED": "."}
_LEFT, _BOTTOM, _BETWEEN = 0.7, 0.65, 0.32


def history_figure(
    data: HistoryInput,
    size: Pixels = (1600, 1000),
    theme: Theme = LIGHT,
    title: str = "The gap over time",
    subtitle: str = "",
) -> bytes:
    """Draw the figure in `size` pixels; `data` must contain a night."""
    page = make_page(size, theme)
    model = history_model(data, MOST_DAYS)
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle) - 0.25
    count = len(model.tracks)
    height = max(0.2, (top - _BOTTOM - (count - 1) * _BETWEEN) / count)
    for index, track in enumerate(model.tracks):
        bottom = _BOTTOM + (count - 1 - index) * (height + _BETWEEN)
        axes = figure.add_axes(page.box(_LEFT, bottom, page.inches[0] - _LEFT - 0.25, height))
        _panel(axes, model, track, page)
        _days(axes, model, labelled=index == count - 1)
        if index == 0:
            _legend(axes, theme)
    return figure_bytes(figure, page)


def _panel(axes: Axes, model: HistoryModel, track: Track, page: Page) -> None:
    theme, days = page.theme, model.days
    style_axes(axes, theme)
    low, high = model.scale
    margin = 0.06 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(days[0] - 0.6, days[-1] + 0.6)
    ends = np.concatenate([[days[0] - 0.6], days, [days[-1] + 0.6]])
    limits = np.concatenate([model.thresholds[:1], model.thresholds, model.thresholds[-1:]])
    axes.plot(ends, limits, color=rgb_fractions(theme.truth), linewidth=1.1, linestyle=(0, (4, 3)),
              drawstyle="steps-mid")  # fmt: skip
    for at, day in enumerate(days):
        colour = rgb_fractions(status_colour(track.statuses[at], theme))
        value, *bounds = np.clip([track.value[at], track.low[at], track.high[at]], low, high)
        if not math.isnan(value):
            axes.plot([day, day], bounds, color=colour, linewidth=1.6, solid_capstyle="butt")
            axes.plot([day], [value], marker=_MARKERS[track.statuses[at]], markersize=5.5,
                      color=colour)  # fmt: skip
    axes.set_ylabel("G")
    name = axes.set_title(track.name, loc="left", fontsize=9.5, pad=4)
    name.set_color(rgb_fractions(theme.text))
    name.set_fontweight("bold" if track.name == HEADLINE else "normal")


def _days(axes: Axes, model: HistoryModel, labelled: bool) -> None:
    """About ten dates, with the newest one."""
    step = -(-model.span // 10)
    ticks = list(range(int(model.days[-1]), int(model.days[0]) - 1, -step))
    dates = [f"{datetime.date.fromordinal(day):%Y-%m-%d}" for day in ticks]
    axes.set_xticks(ticks, dates if labelled else [""] * len(ticks))


def _legend(axes: Axes, theme: Theme) -> None:
    key = axes.set_title("● pass   ▲ fail   ■ inconclusive   - - threshold", loc="right",
                          fontsize=8.5, pad=4)  # fmt: skip
    key.set_color(rgb_fractions(theme.muted))
