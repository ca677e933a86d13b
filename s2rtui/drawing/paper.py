"""Draw a `Drawing` on a page with matplotlib."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from s2rtui.canvas import Theme
from s2rtui.drawing.drawing import ColourBar, Drawing, Note
from s2rtui.drawing.drawing_layout import no_room_notes
from s2rtui.drawing.image_paper import draw_images
from s2rtui.drawing.page import (
    LETTER,
    NARROW,
    Page,
    Pixels,
    colour_bar_ticks,
    draw_colour_bar,
    label_with_unit,
    new_page,
    own_settings,
    value_colours,
    wrapped_label,
)
from s2rtui.drawing.plot import Phrase, Plot, Points
from s2rtui.drawing.plot_paper import LEGEND_COLUMNS, draw_plot, draw_sign
from s2rtui.drawing.points_paper import points_note
from s2rtui.drawing.polar_paper import draw_dials
from s2rtui.drawing.table import TableSpec
from s2rtui.drawing.table_paper import (
    LINE,
    MARGIN,
    draw_table,
    page_layout,
    sentences,
    table_inches,
    wrapped,
)

_BELOW, _LEFT, _RIGHT = 0.7, 0.75, 0.25
"""Inches below the axes of a plot; at its left and at its right."""
_TITLE, _LEGEND_LINE = 0.3, 0.2
"""Inches of the title of a plot, and of a line of its legend."""
_SMALLEST_FONT, _SMALLEST_TABLE_FONT = 4.0, 6.0
_NOTES = 1.0
"""Inches for notes below plots that are left out where not all have room."""
_GAP = 4
"""Letters between phrases beside each other."""
_SIDE, _BAR_BELOW = 1.4, 0.7
"""Inches of a colour bar at the right of the plots, and below those of a narrow page."""
_BETWEEN, _TALLEST = 0.45, 1.25
"""Inches between plots beside each other; height over width of one with equal scales, at most."""
_LEAST_SHARE, _LEAST_HEIGHT = 0.35, 0.55
"""Share of the page below its heading that plots have at least, and least inches of each."""


@own_settings()
def draw_paper(
    drawing: Drawing, size: Pixels, theme: Theme, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the plots above the table and the notes, in `size` pixels.

    A table whose columns do not fit beside each other becomes sentences, or leaves out columns.
    Rows that would leave the plots too little room are left out, and a line says so.
    """
    page = new_page(size, theme, title, subtitle)
    if any(plot.image is not None for plot in drawing.plots):
        draw_images(page, drawing)
        return page.encoded()
    drawing = _without_lightest(page, drawing)
    font = 8 if page.inches[0] <= NARROW else 9
    letters = int((page.inches[0] - 2 * MARGIN) / (LETTER * font))
    bar = next(iter(_colour_bars(drawing)), None)
    below_all = [*drawing.notes, *map(points_note, _points(drawing)[:1])]
    notes = [line for note in below_all for line in _lines(note, letters)]
    table, texts = drawing.table, None
    if table is not None and (texts := sentences(table, letters)) is not None:
        table = None
    top, below = page.top, 0.1 + (len(notes) + 1.5) * LINE
    if drawing.plots:
        least = max(_LEAST_SHARE * page.top, _least_inches(page, drawing))
        most = max(0.0, page.top - least - below)
        if texts is not None and len(texts) * LINE > most:
            kept = max(0, int(most / LINE) - 1)
            texts = [*texts[:kept], f"and {len(texts) - kept} more lines: `s2r show`"]
        height = (
            table_inches(table, letters, font) if table is not None else LINE * len(texts or ())
        )
        below += min(height, most)
        if bar is not None and page.inches[0] <= NARROW:
            _draw_bar_below(page, bar, below)
            below += _BAR_BELOW
        _draw_plots(page, drawing, below, bar)
        top = below
    for row, text in enumerate(texts or ()):
        page.text(MARGIN, top - (row + 1) * LINE, text, page.inks.muted, font)
    if table is not None:
        low = 0.1 + (len(notes) + (1.0 if notes else 0.5)) * LINE
        top -= 0.5 * LINE * (not drawing.plots)
        draw_table(page, table, top, low, _fitting_font(page, table, top - low, font))
    for row, phrases in enumerate(reversed(notes)):
        x = MARGIN
        for phrase in phrases:
            ink, indent = getattr(page.inks, phrase.ink), 0.0
            if phrase.sign is not None:
                indent = 2 * LETTER * font
                draw_sign(page, x + indent / 3, 0.13 + row * LINE, phrase.sign, ink)
            page.text(x + indent, 0.1 + row * LINE, phrase.text, ink, font)
            x += indent + (len(phrase.text) + _GAP) * LETTER * font
    return page.encoded()


def _fitting_font(page: Page, table: TableSpec, room: float, font: float) -> float:
    """The largest font of which no column is cut, and all texts fit into `room` inches."""
    wraps = any(column.wraps for column in table.columns)
    has_texts = wraps or any(row.notes for row in table.rows[:1])
    while font > (_SMALLEST_FONT if wraps else _SMALLEST_TABLE_FONT):
        letters = int((page.inches[0] - 2 * MARGIN) / (LETTER * font))
        is_low = has_texts and table_inches(table, letters, font) > room
        if not is_low and not page_layout(table, letters).is_tight:
            break
        font -= 0.5
    return font


def _lines(note: Note, letters: int) -> list[list[Phrase]]:
    """A note in lines of at most `letters`; phrases stay whole where they fit into a line."""
    if isinstance(note, str):
        return [[Phrase(line)] for line in wrapped(note, letters)]
    lines: list[list[Phrase]] = []
    free = -1
    for phrase in (item for item in note if isinstance(item, Phrase)):
        for number, text in enumerate(wrapped(phrase.text, letters)):
            if number or len(text) + _GAP > free:
                lines.append([])
                free = letters
            lines[-1].append(replace(phrase, text=text, sign=None if number else phrase.sign))
            free -= len(text) + _GAP
    return lines


def _colour_bars(drawing: Drawing) -> list[ColourBar]:
    return [
        item
        for note in drawing.notes if not isinstance(note, str)
        for item in note if isinstance(item, ColourBar)
    ]  # fmt: skip


def _points(drawing: Drawing) -> list[Points]:
    return [mark for plot in drawing.plots for mark in plot.marks if isinstance(mark, Points)]


def _draw_bar_below(page: Page, bar: ColourBar, bottom: float) -> None:
    """A horizontal colour bar with its ticks and its label below."""
    width = page.inches[0] - _LEFT - _RIGHT
    axes = page.axes(_LEFT, bottom + 0.5, width, 0.12)
    low, high = bar.scale
    axes.imshow(value_colours(np.linspace(0, 1, 256)[None]), aspect="auto",
                extent=(low, high, 0, 1), interpolation="none")  # fmt: skip
    axes.set_yticks([])
    axes.set_xticks(*colour_bar_ticks(bar.scale, width / 2.5, bar.clipped))
    axes.tick_params(colors=page.inks.muted, labelsize=8, width=0.8, length=3)
    for spine in axes.spines.values():
        spine.set_visible(False)
    label = label_with_unit(bar.label, bar.unit)
    axes.set_xlabel(label, fontsize=8, color=page.inks.text)


def _draw_plots(page: Page, drawing: Drawing, below: float, bar: ColourBar | None) -> None:
    """Plots of equal size above `below` inches; those with the same scale share its labels."""
    plots, wide = drawing.plots, page.inches[0]
    side = 0.0
    if bar is not None and wide > NARROW:
        side, high = _SIDE, min(2.0, 0.45 * (page.top - below))
        label = wrapped_label(label_with_unit(bar.label, bar.unit), 14)
        left = wide - side + 0.25
        draw_colour_bar(page, left, page.top - high - 0.5, high, bar.scale, label, value_colours,
                        bar.clipped)  # fmt: skip
    if plots[0].turns:
        draw_dials(page, plots, below, _is_beside(page, drawing))
    elif _is_beside(page, drawing):
        _draw_beside(page, plots, below, side)
    else:
        _draw_stacked(page, plots, below, side)


def _without_lightest(page: Page, drawing: Drawing) -> Drawing:
    """Leave out the plots of the smallest weight while not all have room; a note names them."""
    plots, left_out = list(drawing.plots), list[Plot]()
    while plots and _least_inches(page, replace(drawing, plots=tuple(plots))) > page.top - _NOTES:
        lightest = min(plots, key=lambda plot: plot.weight)
        if lightest.weight == max(plot.weight for plot in plots):
            break
        left_out.append(lightest)
        plots.remove(lightest)
    return replace(
        drawing, plots=tuple(plots), notes=(*drawing.notes, *no_room_notes(left_out))
    )  # fmt: skip


def _is_beside(page: Page, drawing: Drawing) -> bool:
    return drawing.beside and page.top <= page.inches[0]


def _least_inches(page: Page, drawing: Drawing) -> float:
    """The least height of the plots with their titles and axes."""
    if _is_beside(page, drawing):
        return _BELOW + _TITLE + 0.15 + _LEAST_HEIGHT
    heads, feet, _ = _beyond_axes(drawing.plots)
    return 0.15 + sum(heads) + sum(feet) + _LEAST_HEIGHT * len(drawing.plots)


def _beyond_axes(plots: tuple[Plot, ...]) -> tuple[list[float], list[float], list[bool]]:
    """Inches above and below each of stacked plots, and whether its axis of x is labelled."""
    heads = [
        _TITLE if plot.title else math.ceil(len(plot.legend) / LEGEND_COLUMNS) * _LEGEND_LINE
        for plot in plots
    ]
    has_axis = [place == len(plots) - 1 or plot.x != plots[place + 1].x
                for place, plot in enumerate(plots)]  # fmt: skip
    return heads, [_BELOW if each else 0.12 for each in has_axis], has_axis


def _draw_beside(page: Page, plots: tuple[Plot, ...], below: float, side: float) -> None:
    room = (page.inches[0] - _LEFT - _RIGHT - side - _BETWEEN * (len(plots) - 1)) / len(plots)
    height = max(0.2, page.top - below - _BELOW - _TITLE - 0.15)
    height = min(height, _TALLEST * room) if plots[0].equal else height
    top = page.top - 0.15 - _TITLE
    for place, plot in enumerate(plots):
        axes = page.axes(_LEFT + place * (room + _BETWEEN), top - height, room, height)
        draw_plot(axes, page, plot.fitted(room, height), (room, height), True, not place)
        if place and plot.y == plots[0].y:
            axes.tick_params(labelleft=False)


def _draw_stacked(page: Page, plots: tuple[Plot, ...], below: float, side: float) -> None:
    """Plots of equal height above `below` inches; those with the same scale share its labels."""
    heads, feet, has_axis = _beyond_axes(plots)
    height = max(0.2, (page.top - below - 0.15 - sum(heads) - sum(feet)) / len(plots))
    top, width = page.top - 0.15, page.inches[0] - _LEFT - _RIGHT - side
    for place, (plot, head, foot) in enumerate(zip(plots, heads, feet, strict=True)):
        axes = page.axes(_LEFT, top - head - height, width, height)
        alike = [at for at, other in enumerate(plots) if other.y == plot.y]
        has_name = place == alike[len(alike) // 2]  # one name for plots with the same scale of y
        draw_plot(
            axes, page, plot.fitted(width, height), (width, height), has_axis[place], has_name
        )
        top -= head + height + foot
