"""The headings on paper: three radial bar charts on one scale."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.orientation.dial import RING
from s2rtui.charts.orientation.model import (
    BINS,
    NAMES,
    Headings,
    OrientationInput,
    OrientationModel,
    orientation_model,
)
from s2rtui.charts.shared.axis_scale import tick_values
from s2rtui.charts.shared.paper import (
    Page,
    Pixels,
    draw_heading,
    figure_bytes,
    make_page,
    new_figure,
    rgb_fractions,
)

FOOT = 0.9
"""Inches below the dials."""
STACKED = 1.2
"""Above this ratio of height to width the dials are stacked."""

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def orientation_figure(
    data: OrientationInput,
    size: Pixels = (1600, 680),
    theme: Theme = LIGHT,
    title: str = "Headings in simulation, in truth and in reality",
    subtitle: str = "",
) -> bytes:
    """Draw the figure in `size` pixels: bars of the selected on scaled grey bars of all."""
    page = make_page(size, theme)
    model = orientation_model(data)
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle)
    wide, high = page.inches
    stacked = high > STACKED * wide
    room = wide - 0.4 if stacked else (wide - 0.4) / 3
    height = max(0.3, (top - FOOT) / (3 if stacked else 1) - 0.75)
    across = max(0.2, min(room - 0.7, height - (0.4 if stacked else 0)))
    inks = (theme.sim, theme.truth, theme.real)
    for index, (name, panel) in enumerate(zip(NAMES, model.panels, strict=True)):
        middle = 0.2 + room * (0.5 if stacked else index + 0.5)
        foot = FOOT + (height - across) / 2 + (2 - index) * (height + 0.75) * stacked
        box = page.box(middle - across / 2, foot, across, across)
        axes = figure.add_axes(box, projection="polar")
        _dial(axes, model, panel, data.y_down, inks[index], page)
        _centred_text(figure, page, (middle, foot + across + 0.45), name, inks[index], bold=True)
        _centred_text(figure, page, (middle, foot - 0.38), _mean(panel), theme.muted, bold=False)
    if page.inches[1] > 2:
        _note(figure, page, model)
    return figure_bytes(figure, page)


def _dial(
    axes: Any,
    model: OrientationModel,
    panel: Headings,
    y_down: bool,
    ink: tuple[int, int, int],
    page: Page,
) -> None:
    theme = page.theme
    axes.set_facecolor(rgb_fractions(theme.background))
    axes.set_theta_zero_location("E")
    axes.set_theta_direction(-1 if y_down else 1)
    peak = float(model.peak)
    axes.set_rorigin(-peak * RING / (1 - RING))
    axes.set_rlim(0, peak)
    middles = np.radians((np.arange(BINS) + 0.5) * 360 / BINS - 180)
    highlighted, grey = model.lengths(panel)
    width = 2 * np.pi / BINS
    pale = rgb_fractions(theme.faint)
    axes.bar(middles, grey * peak, width=width, color=pale, linewidth=0, zorder=2)
    axes.bar(
        middles,
        highlighted * peak,
        width=width * 0.86,
        color=rgb_fractions(ink),
        linewidth=0,
        zorder=3,
    )
    axes.set_xticks(np.radians([0, 90, 180, 270]))
    axes.set_xticklabels(["0°", "90°", "±180°", "−90°"])
    rings = [tick for tick in tick_values(0, peak, 3) if tick > 0 and tick == round(tick)]
    axes.set_yticks(rings)
    axes.set_yticklabels([str(round(tick)) for tick in rings])
    axes.set_rlabel_position(45)
    axes.tick_params(colors=rgb_fractions(theme.muted), labelsize=7.5, pad=3)
    axes.grid(color=rgb_fractions(theme.faint), linewidth=0.6)
    axes.spines["polar"].set_color(rgb_fractions(theme.faint))
    axes.spines["inner"].set_color(rgb_fractions(theme.muted))
    if panel.cursor is not None:
        at = np.radians(panel.cursor)
        axes.plot([at, at], [0, peak], color=rgb_fractions(theme.cursor), linewidth=1.1, zorder=5)
        axes.plot(
            [at], [peak], marker="o", markersize=5, color=rgb_fractions(theme.cursor), zorder=5
        )
        axes.lines[-1].set_clip_on(False)


def _mean(panel: Headings) -> str:
    if not np.isfinite(panel.mean):
        return "none selected"
    return f"mean {panel.mean:.0f}°, R {panel.resultant:.2f}".replace("-", "−")


def _note(figure: Figure, page: Page, model: OrientationModel) -> None:
    """The meaning of the bars, at the bottom."""
    text = f"bars: selected instances per 5°, rim = {model.peak}"
    if model.whole > model.peak + 0.5:
        text += f"; grey: all instances, rim = {model.whole:.0f}; R: resultant length"
    _centred_text(figure, page, (page.inches[0] / 2, 0.22), text, page.theme.muted, bold=False)


def _centred_text(
    figure: Figure,
    page: Page,
    place: tuple[float, float],
    text: str,
    ink: tuple[int, int, int],
    bold: bool,
) -> None:
    x, y = place[0] / page.inches[0], place[1] / page.inches[1]
    label = figure.text(x, y, text, ha="center", va="center", fontsize=11 if bold else 9)
    label.set_color(rgb_fractions(ink))
    label.set_fontweight("bold" if bold else "normal")
