"""The rooms on paper: a row per room, bars for sim, truth and real."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.rooms.model import NAMES, RoomsInput, RoomsModel, rooms_model
from s2rtui.drawing.page import (
    Ink,
    Page,
    Pixels,
    new_page,
    own_settings,
    set_panel_title,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@own_settings()
def rooms_figure(
    data: RoomsInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the figure in `size` pixels: bars of the selected on grey bars of all."""
    page = new_page(size, theme, title, subtitle)
    model = rooms_model(data)
    wide, _ = page.inches
    longest = max((len(name) for name in model.names), default=4)
    left = min(0.35 + 0.08 * min(longest, 28), wide * 0.3)
    room = (wide - left - 0.2) / 3
    height = max(0.3, page.top - 0.6 - 0.3)
    for index, name in enumerate(NAMES):
        axes, ink = (
            page.axes(left + index * room, 0.6, room - 0.25, height),
            getattr(page.inks, name),
        )
        _draw_column(axes, model, index, page, ink, (room - 0.25, height))
        set_panel_title(axes, name, ink)
    return page.encoded()


def _draw_column(
    axes: Axes, model: RoomsModel, index: int, page: Page, ink: Ink, inches: tuple[float, float]
) -> None:
    """Draw the bars of one side in a column of `inches` (width, height)."""
    from matplotlib.ticker import MaxNLocator

    inks, count = page.inks, len(model.names)
    width, height = inches
    style_axes(axes, page)
    rows = np.arange(count)
    highlighted, total = model.highlighted[index], model.total[index]
    axes.barh(rows, total, height=0.72, color=inks.faint, linewidth=0, zorder=2)
    axes.barh(rows, highlighted, height=0.72, color=ink, linewidth=0, zorder=3)
    axes.set_ylim(max(count, 1) - 0.5, -0.5)
    axes.set_xlim(0, model.peak * 1.28)
    axes.set_xlabel("instances: selected / all" if index == 1 else "")
    axes.xaxis.set_major_locator(MaxNLocator(nbins=min(5, max(1, int(width / 0.4))), integer=True))
    axes.set_yticks([])
    if index == 0:
        names = [fit_text(name, 28, "…") for name in model.names]
        axes.set_yticks(rows, names)
        axes.tick_params(axis="y", length=0, pad=9, labelcolor=inks.text)
    points = max(min(8.0, 72 * height / max(count, 1) * 0.7), 1.0)
    for row in rows.tolist():
        x, text = float(total[row]) + 0.015 * model.peak, f"{highlighted[row]}/{total[row]}"
        text_ink = inks.text if highlighted[row] else inks.muted
        axes.text(x, row, text, va="center", fontsize=points, zorder=4, color=text_ink)
    if (cursor_row := model.cursor[index]) is not None:
        axes.plot(
            [-0.025 * model.peak], [cursor_row], marker=">", markersize=6, color=inks.cursor,
            zorder=5, clip_on=False,
        )  # fmt: skip
