"""The rooms on paper: a row per room, bars for sim, truth and real."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.rooms.model import NAMES, RoomsInput, RoomsModel, rooms_model
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


def rooms_figure(
    data: RoomsInput,
    size: Pixels = (1600, 900),
    theme: Theme = LIGHT,
    title: str = "Rooms in simulation, in truth and in reality",
    subtitle: str = "",
) -> bytes:
    """Draw the figure in `size` pixels: bars of the selected on grey bars of all."""
    page = make_page(size, theme)
    model = rooms_model(data)
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle)
    wide, _ = page.inches
    longest = max((len(name) for name in model.names), default=4)
    left = min(0.35 + 0.08 * min(longest, 28), wide * 0.3)
    room = (wide - left - 0.2) / 3
    height = max(0.3, top - 0.6 - 0.3)
    inks = (theme.sim, theme.truth, theme.real)
    for index, name in enumerate(NAMES):
        box = page.box(left + index * room, 0.6, room - 0.25, height)
        axes = figure.add_axes(box)
        _column(axes, model, index, page, inks[index], height)
        label = axes.set_title(name, loc="left", fontsize=10, pad=6)
        label.set_color(rgb_fractions(inks[index]))
        label.set_fontweight("bold")
    return figure_bytes(figure, page)


def _column(
    axes: Axes, model: RoomsModel, index: int, page: Page, ink: tuple[int, int, int], height: float
) -> None:
    from matplotlib.ticker import MaxNLocator

    theme, count = page.theme, len(model.names)
    style_axes(axes, theme)
    rows = np.arange(count)
    highlighted, total = model.highlighted[index], model.total[index]
    axes.barh(rows, total, height=0.72, color=rgb_fractions(theme.faint), linewidth=0, zorder=2)
    axes.barh(rows, highlighted, height=0.72, color=rgb_fractions(ink), linewidth=0, zorder=3)
    axes.set_ylim(max(count, 1) - 0.5, -0.5)
    axes.set_xlim(0, model.peak * 1.28)
    axes.set_xlabel("instances: selected / all" if index == 1 else "")
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
    axes.set_yticks(rows if index == 0 else [])
    if index == 0:
        names = [name if len(name) <= 28 else name[:27] + "…" for name in model.names]
        axes.set_yticklabels(names)
        axes.tick_params(axis="y", length=0, pad=9, labelcolor=rgb_fractions(theme.text))
    points = min(8.0, 72 * height / max(count, 1) * 0.7)
    for row in rows.tolist():
        text = f"{highlighted[row]}/{total[row]}"
        spot = (float(total[row]) + 0.015 * model.peak, row)
        label = axes.text(*spot, text, va="center", fontsize=max(points, 1.0), zorder=4)
        label.set_color(rgb_fractions(theme.text if highlighted[row] else theme.muted))
    cursor_row = model.cursor[index]
    if cursor_row is not None:
        at = -0.025 * model.peak
        axes.plot(
            [at],
            [cursor_row],
            marker=">",
            markersize=6,
            color=rgb_fractions(theme.cursor),
            zorder=5,
        )
        axes.lines[-1].set_clip_on(False)
