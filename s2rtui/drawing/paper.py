"""Draw a `Drawing` on a page with matplotlib."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from s2rtui.canvas import Pixels as Colours
from s2rtui.canvas import Theme
from s2rtui.drawing.drawing import ColourBar, Drawing, Note
from s2rtui.drawing.drawing_layout import no_room_notes
from s2rtui.drawing.heat_colours import change_ramp, heat_ramp
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
from s2rtui.drawing.plane_marks import PlaneMark
from s2rtui.drawing.plane_paper import plane_note
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
_LEAST_SHARE, _TIGHT_SHARE, _LEAST_HEIGHT = 0.35, 0.65, 0.55
"""Share of the page below its heading that plots have at least, and those with the shape of their
scales; least inches of each."""


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
    bars = _colour_bars(drawing)
    below_all = [*_with_plane_notes(drawing), *map(points_note, _points(drawing)[:1])]
    notes = [line for note in below_all for line in _lines(note, letters)]
    table, texts = drawing.table, None
    if table is not None and (texts := sentences(table, letters)) is not None:
        table = None
    top, below = page.top, 0.1 + (len(notes) + 1.5) * LINE
    if drawing.plots:
        least = max(_most_shared(page, drawing), _least_inches(page, drawing))
        most = max(0.0, page.top - least - below)
        if texts is not None and len(texts) * LINE > most:
            kept = max(0, int(most / LINE) - 1)
            texts = [*texts[:kept], f"and {len(texts) - kept} more lines: `s2r show`"]
        height = (
            table_inches(table, letters, font) if table is not None else LINE * len(texts or ())
        )
        below += min(height, most)
        top = below
        if bars and (page.inches[0] <= NARROW or _is_larger_above(page, drawing, below)):
            below += _draw_bars_below(page, bars, below)
            bars = []
        _draw_plots(page, drawing, below, bars)
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


def _with_plane_notes(drawing: Drawing) -> list[Note]:
    """The notes, and in the first one of phrases what each kind of mark of a plane shows."""
    found: dict[type, tuple[Phrase, ...]] = {}
    for mark in (mark for plot in drawing.plots for mark in plot.marks):
        if isinstance(mark, PlaneMark) and not found.get(type(mark)):
            found[type(mark)] = plane_note(mark)
    phrases = tuple(dict.fromkeys(phrase for note in found.values() for phrase in note))
    notes = list(drawing.notes)
    place = next((at for at, note in enumerate(notes) if not isinstance(note, str)), len(notes))
    notes[place : place + 1] = [(*(notes[place] if place < len(notes) else ()), *phrases)]
    return notes


def _bar_colours(bar: ColourBar) -> Callable[[ArrayLike], Colours]:
    if bar.ramp == "values":
        return value_colours
    return change_ramp if bar.ramp == "changes" else heat_ramp(bar.ramp != "heat", value_colours)


def _draw_bars_below(page: Page, bars: list[ColourBar], bottom: float) -> float:
    """Horizontal colour bars beside each other with their ticks and labels below; their height."""
    room = (page.inches[0] - _LEFT - _RIGHT + _SIDE / 2) / len(bars)
    width = max(0.3, room - _SIDE / 2)
    labels = [wrapped_label(label_with_unit(bar.label, bar.unit), int(width / (LETTER * 8)))
              for bar in bars]  # fmt: skip
    more = LINE * max(label.count("\n") for label in labels)
    for place, (bar, label) in enumerate(zip(bars, labels, strict=True)):
        axes = page.axes(_LEFT + place * room, bottom + 0.5 + more, width, 0.12)
        low, high = bar.scale
        axes.imshow(_bar_colours(bar)(np.linspace(0, 1, 256)[None]), aspect="auto",
                    extent=(low, high, 0, 1), interpolation="none")  # fmt: skip
        axes.set_yticks([])
        axes.set_xticks(*colour_bar_ticks(bar.scale, width / 2.5, bar.clipped))
        axes.tick_params(colors=page.inks.muted, labelsize=8, width=0.8, length=3)
        for spine in axes.spines.values():
            spine.set_visible(False)
        axes.set_xlabel(label, fontsize=8, color=page.inks.text)
    return _BAR_BELOW + more


def _is_larger_above(page: Page, drawing: Drawing, below: float) -> bool:
    """Whether plots beside each other are larger above their colour bars than beside these."""
    if not (drawing.plots[0].is_tight and _is_beside(page, drawing)):
        return False
    above, beside = (
        max(_beside_size(page, drawing.plots, foot, side, rows)[0] for rows in (1, 2))
        for foot, side in ((below + _BAR_BELOW + LINE, 0.0), (below, _SIDE))
    )
    return above > beside


def _most_shared(page: Page, drawing: Drawing) -> float:
    """The height that plots have before a table has all of its rows, inches."""
    plots = drawing.plots
    if not plots[0].is_tight:
        return _LEAST_SHARE * page.top
    if not _is_beside(page, drawing):
        return _TIGHT_SHARE * page.top
    room = (page.inches[0] - _LEFT - _RIGHT - _BETWEEN * (len(plots) - 1)) / len(plots)
    whole = plots[0].tight(room, math.inf)[1] + _TITLE + _BELOW + _BAR_BELOW + 2 * LINE
    return min(_TIGHT_SHARE * page.top, whole)


def _draw_plots(page: Page, drawing: Drawing, below: float, bars: list[ColourBar]) -> None:
    """Plots of equal size above `below` inches; those with the same scale share its labels."""
    plots, wide = drawing.plots, page.inches[0]
    side, top = 0.0, page.top
    for bar in bars:
        side, high = _SIDE, min(2.0, 0.45 * (page.top - below) / (0.8 * len(bars) + 0.2))
        label = wrapped_label(label_with_unit(bar.label, bar.unit), 14)
        top -= 0.3 + high + 0.15 * (label.count("\n") + 1)
        draw_colour_bar(page, wide - side + 0.25, top, high, bar.scale, label, _bar_colours(bar),
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
    """Plots in a row; those with the shape of their scales in as many rows as make them large."""
    rows = {number: _beside_size(page, plots, below, side, number) for number in (1, 2)}
    is_larger = plots[0].is_tight and rows[2][0] > rows[1][0]
    columns = -(-len(plots) // 2) if is_larger else len(plots)
    room, height = rows[2] if is_larger else rows[1]
    for place, plot in enumerate(plots):
        row, column = divmod(place, columns)
        bottom = page.top - (row + 1) * (0.15 + _TITLE + height) - row * _BELOW
        axes = page.axes(_LEFT + column * (room + _BETWEEN), bottom, room, height)
        draw_plot(axes, page, plot.fitted(room, height), (room, height), True, not column)
        if column and plot.y == plots[0].y:
            axes.tick_params(labelleft=False)


def _beside_size(
    page: Page, plots: tuple[Plot, ...], below: float, side: float, rows: int
) -> tuple[float, float]:
    """Width and height of plots in `rows` rows, inches."""
    columns = -(-len(plots) // rows)
    room = (page.inches[0] - _LEFT - _RIGHT - side - _BETWEEN * (columns - 1)) / columns
    height = max(0.2, (page.top - below) / rows - _BELOW - _TITLE - 0.15)
    if plots[0].is_tight:
        return plots[0].tight(room, height)
    return room, min(height, _TALLEST * room) if plots[0].equal else height


def _draw_stacked(page: Page, plots: tuple[Plot, ...], below: float, side: float) -> None:
    """Plots of equal height above `below` inches; those with the same scale share its labels."""
    heads, feet, has_axis = _beyond_axes(plots)
    height = max(0.2, (page.top - below - 0.15 - sum(heads) - sum(feet)) / len(plots))
    top, width = page.top - 0.15, page.inches[0] - _LEFT - _RIGHT - side
    for place, (plot, head, foot) in enumerate(zip(plots, heads, feet, strict=True)):
        size = plot.tight(width, height) if plot.is_tight else (width, height)
        axes = page.axes(_LEFT, top - head - size[1], *size)
        alike = [at for at, other in enumerate(plots) if other.y == plot.y]
        has_name = place == alike[len(alike) // 2]  # one name for plots with the same scale of y
        draw_plot(axes, page, plot.fitted(*size), size, has_axis[place], has_name)
        top -= head + height + foot
