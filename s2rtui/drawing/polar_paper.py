"""Dials on a page: plots whose x are degrees of a full turn, on polar axes of matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from s2rtui.canvas import Pixels, Theme
from s2rtui.canvas.render_options import UNICODE
from s2rtui.drawing.page import BOLD, LETTER, NARROW, Page
from s2rtui.drawing.plot import Bars, Dots, Plot
from s2rtui.drawing.plot_paper import drawn_pixels, marker_style, set_ticks
from s2rtui.drawing.polar_cells import RING

_LINE, _HEAD, _LABEL_FONT = 0.2, 0.25, 8
"""Inches of a label and of a title, and font size of labels."""
_SIDE = 0.36
"""Inches beside a disc, for labels of x."""
_LARGEST = 1.6
"""Inches of a disc on a page that is as high as its parts."""
_MARGIN, _PADDING = 0.15, 0.1
"""Inches at the left and right of a row of dials, and of each dial."""
_BETWEEN = 12
"""Degrees beside a label of y in which its bars may cover it."""


def draw_dials(page: Page, plots: Sequence[Plot], below: float, is_beside: bool) -> None:
    """Draw dials of equal size above `below` inches, beside each other or above each other."""
    columns, rows = (len(plots), 1) if is_beside else (1, len(plots))
    width = (page.inches[0] - 2 * _MARGIN) / columns
    height = max(0.3, (page.top - below) / rows)
    for place, plot in enumerate(plots):
        column, row = place % columns, place // columns
        left, top = _MARGIN + column * width, page.top - row * height
        _draw_dial(page, plot, (left, top - height, width, height))


def dial_inches(width: float) -> float:
    """The height of a dial, with its title and labels, on a page that is as high as its parts."""
    return min(width - 2 * _SIDE, _LARGEST) + _HEAD + 3 * _LINE


def dial_pixels(plot: Plot, theme: Theme, size: tuple[int, int]) -> Pixels:
    """The disc of a plot, without labels, in the middle of `size` (height, width) pixels."""

    def draw(page: Page) -> None:
        wide, high = page.inches
        across = 0.96 * min(wide, high)
        axes = _disc(page, plot, ((wide - across) / 2, (high - across) / 2, across))
        axes.set_xticklabels([])
        axes.set_yticklabels([])

    return drawn_pixels(theme, size, draw)


def _draw_dial(page: Page, plot: Plot, box: tuple[float, float, float, float]) -> None:
    """Draw a dial in a box (left, bottom, width, height): name at the left, texts at the right.

    They stand beside the upper label of x where there is room, else above it.
    """
    left, bottom, width, height = box
    font = 8 if page.inches[0] <= NARROW else 9
    name = plot.title[0].text if plot.title else ""
    wide = LETTER * len(name) * (font + 1) * BOLD
    room = (width - 3 * _PADDING - wide) / (LETTER * font)
    texts = "   ".join(phrase.whole(UNICODE, room).replace("-", "−") for phrase in plot.title[1:])
    head = 0.0 if width / 2 > max(wide, LETTER * font * len(texts)) + 0.4 else _HEAD
    across = max(0.2, min(width - 2 * _SIDE, height - head - 3 * _LINE))
    bottom += (height - head - across) / 2
    axes = _disc(page, plot, (left + (width - across) / 2, bottom, across))
    axes.tick_params(axis="x", colors=page.inks.muted, labelsize=_LABEL_FONT, pad=1)
    axes.set_rlabel_position(_free_direction(plot))
    axes.tick_params(axis="y", colors=page.inks.text, labelsize=_LABEL_FONT, pad=0)
    for label in axes.get_yticklabels():
        label.set(path_effects=page.halo(2), zorder=6, ha="center", va="center")
    top = bottom + across + 0.06 + head
    if plot.title:
        ink = getattr(page.inks, plot.title[0].ink)
        page.text(left + _PADDING, top, name, ink, font + 1, fontweight="bold")
        page.text(left + width - _PADDING, top, texts, page.inks.muted, font, ha="right")


def _disc(page: Page, plot: Plot, box: tuple[float, float, float]) -> Any:
    """Polar axes in a square (left, bottom, side) with the marks of a plot."""
    left, bottom, side = box
    axes: Any = page.axes(left, bottom, side, side, projection="polar")
    inks, low, high = page.inks, plot.y.low, plot.y.high
    axes.set_facecolor(inks.background)
    axes.set_theta_zero_location("E")
    axes.set_theta_direction(-1 if plot.turns == "clockwise" else 1)
    axes.set_rorigin(low - (high - low) * RING / (1 - RING))
    axes.set_rlim(low, high)
    set_ticks(axes, page, plot.y, (1 - RING) * side / 2, is_x=False)
    ticks = {degrees % 360: f"{text}°".replace("-", "−") for degrees, text in plot.x.ticks(4)}
    axes.set_xticks(np.radians(list(ticks)), list(ticks.values()))
    axes.set_xlim(0, 2 * np.pi)
    axes.grid(color=inks.faint, linewidth=0.6)
    axes.spines["polar"].set_color(inks.faint)
    axes.spines["inner"].set_color(inks.muted)
    for mark in plot.marks:
        if isinstance(mark, Bars):
            middles = np.radians((mark.edges[:-1] + mark.edges[1:]) / 2)
            widths = np.radians(np.diff(mark.edges))
            style = {"bottom": low, "linewidth": 0}
            axes.bar(middles, mark.whole - low, width=widths, color=inks.faint, zorder=2, **style)
            axes.bar(middles, mark.part - low, width=0.86 * widths,
                     color=getattr(inks, mark.ink), zorder=3, **style)  # fmt: skip
        elif isinstance(mark, Dots):
            ink, turn = getattr(inks, mark.ink), np.radians(mark.x)
            axes.vlines(turn, low, mark.y, color=ink, linewidth=1.1, zorder=5)
            style = marker_style(page, mark.drawn_sign, ink)
            axes.plot(turn, mark.y, zorder=5, clip_on=False, **style)
    return axes


def _free_direction(plot: Plot) -> float:
    """Degrees between the ticks of x in which the bars are the shortest."""

    def longest(degrees: float) -> float:
        lengths = [0.0]
        for bars in (mark for mark in plot.marks if isinstance(mark, Bars)):
            middles = (bars.edges[:-1] + bars.edges[1:]) / 2
            near = np.abs((middles - degrees + 180) % 360 - 180) < _BETWEEN
            lengths += np.maximum(bars.part, bars.whole)[near].tolist()
        return max(lengths)

    directions = [turn + aside for aside in (45.0, 60.0, 30.0) for turn in (0, 90, 180, 270)]
    return min(directions, key=longest)
