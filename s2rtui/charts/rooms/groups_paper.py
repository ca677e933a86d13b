"""The groups on paper: median errors with their intervals, a row per group."""

from __future__ import annotations

import numpy as np

from s2rtui.canvas import LIGHT, Theme
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.rooms.groups import GroupsInput, ordered
from s2rtui.drawing.page import LETTER, Pixels, new_page, own_settings, style_axes

_ROW = 0.16
"""Inches that a row needs at least."""
_FONT, _SMALLEST_FONT = 9.0, 5.0


@own_settings()
def groups_figure(
    data: GroupsInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the rows that fit in `size` pixels, in the order of the table."""
    page = new_page(size, theme, title, subtitle)
    inks, (wide, _) = page.inks, page.inches
    bottom, height = 0.65, max(0.3, page.top - 0.65 - 0.35)
    rows = ordered(data)
    shown = rows[: max(1, int(height / _ROW))]
    names = [row.group.name for row in shown]
    counts = [_count(row.n, data.selected.get(row.group.name, 0)) for row in shown]
    letters = max((len(name) for name in names), default=4)
    left = min(0.3 + LETTER * _FONT * letters, wide * 0.4)
    most = max(3, int((left - 0.25) / (LETTER * _FONT)))
    names = [fit_text(name, most, "…") for name in names]
    right = 0.25 + LETTER * _FONT * max((len(count) for count in counts), default=3)
    axes = page.axes(left, bottom, max(0.3, wide - left - right), height)
    style_axes(axes, page)
    for place, row in enumerate(shown):
        if row.real.is_known:
            axes.plot(row.real.bounds, [place, place], color=inks.real, linewidth=2)
    at = np.arange(len(shown))
    axes.plot([row.sim for row in shown], at, "D", color=inks.sim, markersize=5, label="sim")
    medians = [row.real.value for row in shown]
    axes.plot(medians, at, "o", color=inks.real, markersize=6, label="real, 95 %")
    points = min(_FONT, max(_SMALLEST_FONT, 72 * height / max(len(shown), 1) * 0.7))
    axes.set_yticks(at, names, fontsize=points)
    axes.tick_params(axis="y", length=0, labelcolor=inks.text)
    axes.set_ylim(max(len(shown), 1) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.grid(axis="x", color=inks.faint, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("median position error (m)")
    for place, count in enumerate(counts):
        axes.annotate(
            count, (1, place), (6, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", fontsize=points, color=inks.muted,
        )  # fmt: skip
    if shown:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False, fontsize=_FONT,
            labelcolor=inks.text, borderaxespad=0.2,
        )  # fmt: skip
    missing = len(rows) - len(shown)
    if missing:
        page.text(0.3, 0.15, f"{missing} more groups", inks.muted, 8)
    return page.encoded()


def _count(n: int, selected: int) -> str:
    """The number of instances of a row, and of the selected ones if these are fewer."""
    return f"n {n}" if selected == n else f"{selected} of n {n}"
