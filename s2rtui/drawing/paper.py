"""Draw a `Drawing` on a page with matplotlib."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING

import numpy as np

from s2rtui.canvas import Theme
from s2rtui.drawing.page import (
    LETTER,
    NARROW,
    Ink,
    Page,
    Pixels,
    new_page,
    own_settings,
    style_axes,
)
from s2rtui.drawing.plot import Dots, Drawing, Line, Mark, Plot, TableSpec
from s2rtui.drawing.scale import Scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINE = 0.17
"""Height of a line of the table and the notes in inches."""
_MARGIN, _BELOW, _LEFT, _RIGHT = 0.3, 0.7, 0.75, 0.25
"""Inches beside texts; below the axes of a plot; at its left and at its right."""
_LEAST_SHARE = 0.35
"""Share of the page below its heading that a plot has at least."""
_GAP = 3
"""Letters between the columns of a table."""
_X_TICKS, _Y_TICKS = 0.7, 0.35
"""Inches between ticks at least."""
_LEGEND_COLUMNS, _LEGEND_LINE = 2, 0.2
"""Columns of the legend above a plot, and the height of its lines in inches."""
Words = list[tuple[float, str, Ink]]
"""A line: places in inches, texts and their colours."""


@own_settings()
def draw_paper(
    drawing: Drawing, size: Pixels, theme: Theme, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the plot above the table and the notes, in `size` pixels.

    Columns that do not fit beside each other become sentences. Rows of the table that would leave
    the plot too little room are left out, and a line says so.
    """
    page = new_page(size, theme, title, subtitle)
    font = 8 if page.inches[0] <= NARROW else 9
    letter = LETTER * font
    room = page.inches[0] - 2 * _MARGIN
    notes = [_plain(page, line) for text in drawing.notes for line in _wrapped(text, room, letter)]
    lines = [] if drawing.table is None else _table(page, drawing.table, room, letter)
    if drawing.plot is not None:
        most = int((1 - _LEAST_SHARE) * page.top / _LINE) - len(notes)
        if len(lines) > max(1, most):
            hidden = len(lines) - max(1, most) + 1
            lines = [*lines[:-hidden], _plain(page, f"and {hidden} more lines: `s2r show`")]
    lines += notes
    if drawing.plot is not None:
        low = _BELOW + len(lines) * _LINE
        legend = math.ceil(len(drawing.plot.legend) / _LEGEND_COLUMNS)
        height = page.top - low - 0.15 - legend * _LEGEND_LINE
        axes = page.axes(_LEFT, low, page.inches[0] - _LEFT - _RIGHT, height)
        _draw_plot(axes, page, drawing.plot, font, height)
    top = 0.1 + (len(lines) - 1) * _LINE if drawing.plot else page.top - 2 * _LINE
    for row, words in enumerate(lines):
        for x, text, ink in words:
            page.text(_MARGIN + x, top - row * _LINE, text, ink, font)
    return page.encoded()


def _plain(page: Page, text: str) -> Words:
    return [(0.0, text, page.inks.muted)]


def _wrapped(text: str, room: float, letter: float) -> list[str]:
    return textwrap.wrap(text, max(20, int(room / letter)))


def _table(page: Page, table: TableSpec, room: float, letter: float) -> list[Words]:
    """The lines of a table: in columns where they fit, else each row as a sentence."""
    names = [column.name for column in table.columns]
    rows = [names, *([cell.whole for cell in row] for row in table.rows)]
    widths = [letter * (_GAP + max(map(len, column))) for column in zip(*rows, strict=True)]
    if sum(widths) > room:
        lines = [
            line for text in table.sentences("\u00a0") for line in _wrapped(text, room, letter)
        ]
        return [_plain(page, line) for line in lines]
    inks = [getattr(page.inks, column.ink) for column in table.columns]
    texts = [page.inks.muted, *[page.inks.text] * (len(widths) - 1)]
    starts = [sum(widths[:place]) for place in range(len(widths))]
    return [
        list(zip(starts, row, texts if number else inks, strict=True))
        for number, row in enumerate(rows)
    ]


def _draw_plot(axes: Axes, page: Page, plot: Plot, font: float, height: float) -> None:
    style_axes(axes, page)
    width = page.inches[0] - _LEFT - _RIGHT
    for mark in plot.marks:
        _draw_mark(axes, page, mark)
    for axis, scale in ((axes.xaxis, plot.x), (axes.yaxis, plot.y)):
        axis.axes.set(**{f"{axis.axis_name}lim": (scale.low, scale.high)})
        if scale.log:
            getattr(axes, f"set_{axis.axis_name}scale")("log")
        is_x = axis.axis_name == "x"
        axis.set_ticks(*_ticks(scale, width if is_x else height, is_x))
        axis.set_ticks([], minor=True)
    axes.set_xlabel(plot.x.name(width, lambda text: LETTER * 9 * len(text)) or plot.x.names[-1])
    axes.set_ylabel(plot.y.names[0])
    if plot.legend:
        axes.legend(
            loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0, ncols=_LEGEND_COLUMNS,
            fontsize=font, frameon=False, labelcolor=page.inks.text,
        )  # fmt: skip


def _ticks(scale: Scale, inches: float, is_x: bool) -> tuple[list[float], list[str]]:
    """The ticks of an axis and their labels, empty where they would collide."""
    letter = LETTER * 8
    apart, gap = (_X_TICKS, letter) if is_x else (_Y_TICKS, 0.0)

    def extent(text: str) -> float:
        return letter * len(text) if is_x else _LINE

    most = max(2, int(inches / apart))
    kept = {text for *_, text in scale.labels(inches, most, extent, gap)}
    ticks = scale.ticks(most)
    return [value for value, _ in ticks], [text if text in kept else "" for _, text in ticks]


def _draw_mark(axes: Axes, page: Page, mark: Mark) -> None:
    ink = getattr(page.inks, mark.ink)
    if isinstance(mark, Line):
        width = 1.2 if mark.ink in ("faint", "unselected") else 1.6
        style = (0, (3, 2)) if mark.dashed else "-"
        axes.plot(
            mark.x, mark.y, color=ink, linewidth=width, linestyle=style, label=mark.name or None
        )
    elif isinstance(mark, Dots):
        at = mark.x * mark.shift
        if mark.low is not None and mark.high is not None:
            known = np.isfinite(mark.low) & np.isfinite(mark.high)
            axes.vlines(at[known], mark.low[known], mark.high[known], color=ink, linewidth=1.1)
        face = ink if mark.ink == "sim" else page.inks.background
        axes.plot(at, mark.y, marker="D" if mark.ink == "sim" else "o", markersize=5, color=ink,
                  markerfacecolor=face, linestyle="none", zorder=5, clip_on=False)  # fmt: skip
    else:
        line = axes.axvline if mark.axis == "x" else axes.axhline
        line(mark.at, color=page.inks.faint, linewidth=0.8, zorder=0)
