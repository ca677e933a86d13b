"""The headings on paper: three radial bar charts on one scale."""

from __future__ import annotations

import textwrap
from typing import Any

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
from s2rtui.drawing.page import LETTER, Ink, Page, Pixels, new_page, own_settings
from s2rtui.drawing.scale import tick_values

FOOT = 0.9
"""Inches below the dials."""
LARGE_DIAL = 1.9
"""Dials of more inches have several rings with numbers."""
STACKED = 1.2
"""Above this ratio of height to width the dials are stacked."""
_CENTRED = {"ha": "center", "va": "center"}


@own_settings()
def orientation_figure(
    data: OrientationInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the figure in `size` pixels: bars of the selected on scaled grey bars of all."""
    page = new_page(size, theme, title, subtitle)
    model = orientation_model(data)
    wide, high = page.inches
    stacked = high > STACKED * wide
    room = wide - 0.4 if stacked else (wide - 0.4) / 3
    height = max(0.3, (page.top - FOOT) / (3 if stacked else 1) - 0.75)
    across = max(0.2, min(room - 0.7, height - (0.4 if stacked else 0)))
    for index, (name, panel) in enumerate(zip(NAMES, model.panels, strict=True)):
        middle = 0.2 + room * (0.5 if stacked else index + 0.5)
        foot = FOOT + (height - across) / 2 + (2 - index) * (height + 0.75) * stacked
        axes = page.axes(middle - across / 2, foot, across, across, projection="polar")
        ink = getattr(page.inks, name)
        _draw_dial(axes, model, panel, data.y_down, ink, page, across)
        page.text(middle, foot + across + 0.45, name, ink, 11, fontweight="bold", **_CENTRED)
        page.text(middle, foot - 0.38, _mean(panel), page.inks.muted, 9, **_CENTRED)
    if high > 2:
        note = f"bars: selected instances per 5°, rim = {model.peak}"
        if model.whole > model.peak + 0.5:
            note += f"; grey: all instances, rim = {model.whole:.0f}; R: resultant length"
        lines = textwrap.wrap(note, int((wide - 0.3) / (9 * LETTER)))
        for row, line in enumerate(reversed(lines)):
            page.text(wide / 2, 0.2 + 0.17 * row, line, page.inks.muted, 9, **_CENTRED)
    return page.encoded()


def _draw_dial(
    axes: Any,
    model: OrientationModel,
    panel: Headings,
    y_down: bool,
    ink: Ink,
    page: Page,
    across: float,
) -> None:
    """Draw a dial of `across` inches."""
    inks, peak = page.inks, float(model.peak)
    axes.set_facecolor(inks.background)
    axes.set_theta_zero_location("E")
    axes.set_theta_direction(-1 if y_down else 1)
    axes.set_rorigin(-peak * RING / (1 - RING))
    axes.set_rlim(0, peak)
    middles = np.radians((np.arange(BINS) + 0.5) * 360 / BINS - 180)
    highlighted, grey = model.lengths(panel)
    width = 2 * np.pi / BINS
    axes.bar(middles, grey * peak, width=width, color=inks.faint, linewidth=0, zorder=2)
    axes.bar(middles, highlighted * peak, width=width * 0.86, color=ink, linewidth=0, zorder=3)
    axes.set_xticks(np.radians([0, 90, 180, 270]), ["0°", "90°", "±180°", "−90°"])
    most = 3 if across > LARGE_DIAL else 1
    rings = [tick for tick in tick_values(0, peak, most) if tick > 0 and tick == round(tick)]
    axes.set_yticks(rings, [str(round(tick)) for tick in rings])
    axes.set_rlabel_position(45)
    axes.tick_params(colors=inks.muted, labelsize=7.5, pad=3)
    axes.grid(color=inks.faint, linewidth=0.6)
    axes.spines["polar"].set_color(inks.faint)
    axes.spines["inner"].set_color(inks.muted)
    if panel.cursor is not None:
        at = np.radians(panel.cursor)
        axes.plot([at, at], [0, peak], color=inks.cursor, linewidth=1.1, zorder=5)
        axes.plot(
            [at], [peak], marker="o", markersize=5, color=inks.cursor, zorder=5, clip_on=False
        )


def _mean(panel: Headings) -> str:
    if not np.isfinite(panel.mean):
        return "none selected"
    return f"mean {panel.mean:.0f}°, R {panel.resultant:.2f}".replace("-", "−")
