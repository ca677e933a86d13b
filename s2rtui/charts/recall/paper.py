"""The recall on paper: a curve per side, and the thresholds with their intervals."""

from __future__ import annotations

import textwrap

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.recall.model import RecallModel
from s2rtui.charts.shared.paper import LETTER, NARROW, Pixels, new_page, own_settings, style_axes

_LINE = 0.17
"""Height of a line of notes in inches."""
_SHIFT = 1.012
"""Factor that sets the marks of both sides apart on the axis of positions."""
_SAMPLES = 3000


@own_settings()
def recall_figure(
    model: RecallModel, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the figure in `size` pixels."""
    page = new_page(size, theme, title, subtitle)
    inks, font = page.inks, 8 if page.inches[0] <= NARROW else 9
    rows = [
        f"{name}: sim {sim}{_in_brackets(sim_bounds)}, real {real}{_in_brackets(real_bounds)}"
        for name, sim, sim_bounds, real, real_bounds in model.rows()
    ]
    notes = [*rows, *(note for note in (model.counted, model.reason) if note)]
    letters = max(20, int((page.inches[0] - 0.6) / (LETTER * font)))
    lines = [line for note in notes for line in textwrap.wrap(note, letters)]
    low = 0.75 + len(lines) * _LINE
    axes = page.axes(0.75, low, page.inches[0] - 1.0, max(0.3, page.top - low - 0.15))
    style_axes(axes, page)
    metres = model.metres(np.linspace(0, 1, _SAMPLES))
    for (name, side), marker, apart in zip(model.sides, "Do", (1 / _SHIFT, _SHIFT), strict=True):
        ink = getattr(inks, name)
        if side.everything is not None:
            axes.plot(metres, 100 * side.everything.at(metres), color=inks.faint, linewidth=1.2)
        axes.plot(metres, 100 * side.curve.at(metres), color=ink, linewidth=1.6, label=name)
        for point in side.figures.points:
            at, share = point.metres * apart, point.share.scaled(100)
            if share.is_known:
                axes.plot([at, at], [share.low, share.high], color=ink, linewidth=1.1)
            face = ink if name == "sim" else inks.background
            axes.plot([at], [share.value], marker=marker, markersize=5, color=ink,
                      markerfacecolor=face, linestyle="none", zorder=5)  # fmt: skip
    points = model.real.figures.points
    for point in points:
        axes.axvline(point.metres, color=inks.faint, linewidth=0.8, zorder=0)
    axes.set_xscale("log")
    axes.set_xlim(*model.limits)
    axes.set_xticks([point.metres for point in points], [f"{point.metres:g}" for point in points])
    axes.set_xticks([], minor=True)
    axes.set_ylim(-2, 102)
    long, short = model.axis_names
    axes.set_xlabel(f"position (m); {short}" if page.inches[0] <= NARROW else long)
    axes.set_ylabel("recall (%)")
    axes.legend(loc="upper left", fontsize=font, frameon=False, labelcolor=inks.text)
    for row, line in enumerate(reversed(lines)):
        page.text(0.3, 0.1 + row * _LINE, line, inks.muted, font)
    return page.encoded()


def _in_brackets(bounds: str) -> str:
    return f" ({bounds})" if bounds else ""
