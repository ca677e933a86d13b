"""Draw a `Drawing` on a page with matplotlib."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from itertools import groupby

from s2rtui.canvas import Theme
from s2rtui.drawing.drawing import ColourBar, Drawing, Note
from s2rtui.drawing.drawing_layout import no_room_notes
from s2rtui.drawing.page import (
    LETTER,
    NARROW,
    Page,
    Pixels,
    draw_colour_bar,
    margin,
    new_page,
    own_settings,
    page_dpi,
    wrapped_label,
)
from s2rtui.drawing.plane_marks import PlaneMark
from s2rtui.drawing.plane_paper import plane_note
from s2rtui.drawing.plot import Phrase, Plot, Points
from s2rtui.drawing.plot_paper import LEGEND_COLUMNS, dial_inches, draw_dials, draw_plot, draw_sign
from s2rtui.drawing.table_paper import (
    LINE,
    draw_table,
    page_layout,
    sentences,
    table_inches,
    wrapped,
)

_BELOW, _LEFT, _RIGHT = 0.55, 0.75, 0.25
"""Inches below the axes of a plot; at its left and at its right."""
_IMAGE_LEFT, _IMAGE_GAP = 0.42, 0.12
"""Inches at the left of images, and between them."""
_SHEET = 1.2
"""Columns for each row of thumbnails, about."""
_TITLE, _LEGEND_LINE, _ABOVE = 0.3, 0.2, 0.15
"""Inches of the title of a plot, of a line of its legend, and above all plots."""
_SMALLEST_FONT = 6.0
"""Points of the smallest font of a table."""
_NOTES = 1.0
"""Inches for notes below plots that are left out where not all have room."""
_GAP = 4
"""Letters between phrases beside each other."""
_BAR_SIDE, _TEXT_SIDE = 1.5, 2.8
"""Inches at the right of plots for colour bars and notes, and for a table with them."""
_BAR_HEIGHT, _BAR_ROOM, _BAR_ABOVE, _BAR_FOOT = 1.4, 1.3, 0.6, 0.45
"""Height of an upright colour bar, its width with the labels, and what is above and below it."""
_BAR_STEP = _BAR_ABOVE + _BAR_HEIGHT + _BAR_FOOT
_BAR_BELOW, _BAR_THICK = 0.75, 0.12
"""Height of a colour bar that lies below plots with its labels, and of the bar alone, inches."""
_BETWEEN, _TALLEST = 0.45, 1.25
"""Inches between plots with the same scale of y; height over width of one with equal scales, at
most.
"""
_LEAST_SHARE, _TIGHT_SHARE, _LEAST_HEIGHT = 0.35, 0.65, 0.55
"""Share of the page below its heading that plots have at least, and those with the shape of their
scales; least inches of each."""
_SINGLE, _SEVERAL, _PLANE = 2.1, 1.0, 3.2
"""Height of a plot, of each of several, and of a plane on a page that is as high as its parts."""


@own_settings()
def draw_paper(
    drawing: Drawing, size: Pixels, theme: Theme, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the plots, their colour bars, the table and the notes in `size` pixels.

    A page of height 0 becomes as high as its parts. Bars, table and notes are below the plots, or
    at the right of plots with the shape of their scales that are larger so. A table whose columns
    do not fit beside each other becomes sentences, or leaves out columns. Rows that would leave
    the plots too little room are left out, and a line says so.
    """
    if size[1]:
        page = new_page(size, theme, title, subtitle)
        parts = _largest(_without_lightest(drawing, page), page)
    else:
        parts = _natural(drawing, size[0] / page_dpi(size))
        page = new_page(size, theme, title, subtitle, parts.height)
    _draw(page, parts)
    return page.encoded()


class _Parts:
    """The parts of a drawing on a page of some width; lengths are inches.

    columns: plots beside each other. side: width of bars, table and notes at the right of the
    plots; 0 where these are below the plots.
    """

    def __init__(self, drawing: Drawing, wide: float, columns: int, side: float = 0.0) -> None:
        self.drawing, self.wide, self.columns, self.side = drawing, wide, columns, side
        self.plots = drawing.plots
        self.rows = -(-len(self.plots) // columns)
        self.has_images = any(plot.image is not None for plot in self.plots)
        self.font = 8.0 if wide <= NARROW else 9.0
        self.left = wide - side if side else margin(wide)
        self.text_width = (side or wide - self.left) - margin(wide)
        self.letters = int(self.text_width / (LETTER * self.font))
        self.texts = [] if drawing.table is None else sentences(drawing.table, self.letters)
        has_rows = drawing.table is not None and drawing.table.rows and not self.texts
        self.table = drawing.table if has_rows else None
        self.bars = [
            item for note in drawing.notes if not isinstance(note, str)
            for item in note if isinstance(item, ColourBar)
        ]  # fmt: skip
        notes = _with_plane_notes(drawing)
        self.notes = [line for note in notes for line in _lines(note, self.letters)]

    @cached_property
    def table_font(self) -> float:
        """The largest font in which no column is left out; else that of the page, or the smallest
        one where strips are too short in it.
        """
        font, wraps = self.font, any(row.wraps for row in self.table.columns) if self.table else 0
        while self.table is not None and not wraps and font >= _SMALLEST_FONT:
            layout = page_layout(self.table, self.letters_of(font))
            if len(layout.columns) == len(self.table.columns) and not layout.is_tight:
                return font
            font -= 0.5
        if self.table is not None and page_layout(self.table, self.letters).is_tight:
            return _SMALLEST_FONT
        return self.font

    def letters_of(self, font: float) -> int:
        return int(self.text_width / (LETTER * font))

    @property
    def bars_height(self) -> float:
        if self.side and self.bars:
            return math.ceil(len(self.bars) / self.bars_beside) * _BAR_STEP
        lines = [label.count("\n") + (bar.ramp == "depth")
                 for bar, label in zip(self.bars, self.bar_labels, strict=True)]  # fmt: skip
        return _BAR_BELOW + LINE * max(lines) if lines else 0.0

    @property
    def bars_beside(self) -> int:
        """Upright bars beside each other at the right of plots; further ones are below them."""
        return max(1, int(self.side / _BAR_ROOM))

    @property
    def bar_width(self) -> float:
        """The length of each of the bars below plots, beside each other."""
        return max(0.3, (self.wide - _LEFT - _RIGHT + _BETWEEN) / len(self.bars) - _BETWEEN)

    @property
    def bar_labels(self) -> list[str]:
        room = 1.1 if self.side else self.bar_width if self.bars else 0.0
        return [wrapped_label(bar, int(room / (LETTER * 8))) for bar in self.bars]

    @cached_property
    def table_height(self) -> float:
        if self.table is None:
            return LINE * len(self.texts)
        return table_inches(self.table, self.letters_of(self.table_font), self.table_font)

    @property
    def notes_height(self) -> float:
        return 0.1 + (len(self.notes) + 1.0) * LINE

    def beyond_axes(self, place: int) -> tuple[float, float]:
        """Inches above and below the axes of a plot; its axis of x has labels where it has some."""
        plot, below = self.plots[place], place + self.columns
        if plot.image is not None:
            return _TITLE * (self.drawing.thumbnails or place < self.columns), _IMAGE_GAP
        lines = math.ceil(len(plot.legend) / LEGEND_COLUMNS)
        head = _TITLE if plot.title else lines * _LEGEND_LINE
        return head, _BELOW if self.has_x(place) or below >= len(self.plots) else 0.12

    def has_x(self, place: int) -> bool:
        """Whether the plot below another one does not share its axis of x."""
        below = place + self.columns
        return below >= len(self.plots) or self.plots[place].x != self.plots[below].x

    def heads_and_feet(self, row: int) -> tuple[float, float]:
        places = range(row * self.columns, min(len(self.plots), (row + 1) * self.columns))
        heads, feet = zip(*map(self.beyond_axes, places), strict=True)
        return max(heads), max(feet)

    @property
    def beyond(self) -> float:
        """Inches above and below the axes of all rows of plots."""
        return _ABOVE + sum(sum(self.heads_and_feet(row)) for row in range(self.rows))

    @property
    def between(self) -> float:
        if self.has_images:
            return _IMAGE_GAP
        return _BETWEEN if all(plot.y == self.plots[0].y for plot in self.plots) else _LEFT

    @property
    def start(self) -> float:
        return _IMAGE_LEFT if self.has_images else _LEFT

    def plot_size(self, room: float) -> tuple[float, float]:
        """Width and height of each plot in a page whose plots have `room`, with what is around."""
        free = self.wide - self.start - _RIGHT - self.side - self.between * (self.columns - 1)
        width, height = free / self.columns, max(0.2, (room - self.beyond) / max(1, self.rows))
        if self.plots and self.plots[0].has_own_shape:
            return self.plots[0].tight(width, height)
        if self.plots and self.plots[0].equal:
            return width, min(height, _TALLEST * width)
        return width, height

    @property
    def plots_height(self) -> float:
        """The height of all plots on a page that is as high as its parts."""
        if not self.plots:
            return 0.0
        first = self.plots[0]
        if first.turns:
            return self.rows * dial_inches(self.wide / self.columns)
        width, height = self.plot_size(math.inf)
        if first.equal and not first.has_own_shape:
            height = min(height, max(0.6 * width, first.tight(width, math.inf)[1]))
        elif not first.has_own_shape:
            height = min(width, _PLANE) if first.shape == "plane" else _SEVERAL
            height = _SINGLE if first.shape != "plane" and self.rows == 1 else height
        return self.beyond + self.rows * height

    @property
    def texts_height(self) -> float:
        """The height of bars, table and notes."""
        return self.bars_height + self.table_height + self.notes_height

    @property
    def height(self) -> float:
        """The height of all parts."""
        if self.side:
            return max(self.plots_height, _ABOVE + self.texts_height)
        return self.plots_height + self.texts_height

    @property
    def least(self) -> float:
        """The least height of the plots with their titles and axes."""
        return self.beyond + _LEAST_HEIGHT * self.rows


def _columns(drawing: Drawing, is_beside: bool) -> int:
    """Plots beside each other: images of a row, else all or one."""
    if drawing.plots and drawing.plots[0].image is not None:
        if drawing.thumbnails:
            return math.ceil(math.sqrt(_SHEET * len(drawing.plots)))
        return len(next(iter(list(row) for _, row in groupby(drawing.plots, lambda p: p.y.names))))
    return max(1, len(drawing.plots)) if drawing.beside and is_beside else 1


def _side(drawing: Drawing) -> float:
    """The width that bars, table and notes have at the right of plots; 0 where they are below."""
    if not drawing.plots or not drawing.plots[0].has_own_shape:
        return 0.0
    if drawing.table is not None:
        return _TEXT_SIDE
    parts = _Parts(drawing, 2 * NARROW, 1)
    return _BAR_SIDE if parts.bars or parts.notes else 0.0


def _natural(drawing: Drawing, wide: float) -> _Parts:
    """The parts of a page that becomes as high as they are."""
    columns = _columns(drawing, wide > NARROW)
    is_side = wide > NARROW and (columns == 1 or drawing.plots[0].image is not None)
    return _Parts(drawing, wide, columns, _side(drawing) if is_side else 0.0)


def _largest(drawing: Drawing, page: Page) -> _Parts:
    """The parts of a page in the arrangement in which its plots are the largest."""
    wide = page.inches[0]
    columns = _columns(drawing, page.top <= wide)
    shown = [_Parts(drawing, wide, columns)]
    if side := _side(drawing):
        beside = [_Parts(drawing, wide, columns, width) for width in sorted({side, _TEXT_SIDE})]
        shown += [each for each in beside if each.bars_height + each.notes_height <= page.top]
        if drawing.beside and columns > 1:
            shown.append(_Parts(drawing, wide, -(-columns // 2)))
    return max(shown, key=lambda parts: parts.plot_size(_room(page, parts)))


def _room(page: Page, parts: _Parts) -> float:
    """The height that plots have on a page; a table below them may lose rows for them."""
    if parts.side:
        return page.top - 0.1
    tight = bool(parts.plots) and parts.plots[0].has_own_shape
    share = _TIGHT_SHARE if tight else _LEAST_SHARE
    least = max(min(share * page.top, parts.plots_height), parts.least)
    return max(page.top - parts.texts_height, min(least, page.top - parts.notes_height))


def _without_lightest(drawing: Drawing, page: Page) -> Drawing:
    """Leave out the plots of the smallest weight while not all have room; a note names them."""
    plots, left_out = list(drawing.plots), list[Plot]()
    columns = _columns(drawing, page.top <= page.inches[0])
    while plots and len(plots) > columns:
        parts = _Parts(replace(drawing, plots=tuple(plots)), page.inches[0], columns)
        lightest = min(plots, key=lambda plot: plot.weight)
        if parts.least <= page.top - _NOTES or lightest.weight == max(p.weight for p in plots):
            break
        left_out.append(lightest)
        plots.remove(lightest)
    notes = (*drawing.notes, *no_room_notes(left_out))
    return replace(drawing, plots=tuple(plots), notes=notes)


def _draw(page: Page, parts: _Parts) -> None:
    """Draw the plots, and at their right or below them bars, table and notes."""
    room = _room(page, parts) if parts.plots else 0.0
    top, low = page.top - room, parts.notes_height - LINE
    if parts.side:
        top = page.top - _ABOVE
        low = max(low, top - parts.texts_height + parts.notes_height - LINE)
    if parts.plots and parts.plots[0].turns:
        draw_dials(page, parts.plots, page.top - room, parts.columns > 1)
    else:
        _draw_plots(page, parts, room)
    _draw_bars(page, parts, top)
    top -= parts.bars_height
    texts = parts.texts
    if len(texts) * LINE > top - low:
        kept = max(0, int((top - low) / LINE) - 1)
        texts = [*texts[:kept], f"and {len(texts) - kept} more lines: `s2r show`"]
    for row, text in enumerate(texts):
        page.text(parts.left, top - (row + 1) * LINE, text, page.inks.muted, parts.font)
    if parts.table is not None:
        font = parts.table_font
        draw_table(page, parts.table, top, low, font, parts.left, parts.text_width)
    for row, phrases in enumerate(reversed(parts.notes)):
        _draw_phrases(page, parts, phrases, low - (len(parts.notes) - row) * LINE)


def _draw_phrases(page: Page, parts: _Parts, phrases: list[Phrase], y: float) -> None:
    x, letter = parts.left, LETTER * parts.font
    for phrase in phrases:
        ink, indent = getattr(page.inks, phrase.ink), 0.0
        if phrase.sign is not None:
            indent = 2 * letter
            draw_sign(page, x + indent / 3, y + 0.03, phrase.sign, ink)
        page.text(x + indent, y, phrase.text, ink, parts.font)
        x += indent + (len(phrase.text) + _GAP) * letter


def _draw_plots(page: Page, parts: _Parts, room: float) -> None:
    """Plots of equal size in rows; neighbours with the same scale share its labels."""
    width, height = parts.plot_size(room)
    top = page.top - _ABOVE
    for row in range(parts.rows):
        head, foot = parts.heads_and_feet(row)
        for column in range(min(parts.columns, len(parts.plots) - row * parts.columns)):
            place = row * parts.columns + column
            plot = parts.plots[place]
            left = parts.start + column * (width + parts.between)
            axes = page.axes(left, top - head - height, width, height)
            alike = [at for at, other in enumerate(parts.plots) if other.y == plot.y]
            has_name = parts.columns > 1 or place == alike[len(alike) // 2]
            has_name &= not column or plot.y.names != parts.plots[place - 1].y.names
            shown, has_title = plot.fitted(width, height), plot.image is None or head > 0
            draw_plot(axes, page, shown, (width, height), parts.has_x(place), has_name, has_title)
            if column and plot.y == parts.plots[place - 1].y:
                axes.tick_params(labelleft=False)
        top -= head + height + foot


def _draw_bars(page: Page, parts: _Parts, top: float) -> None:
    """Colour bars beside each other: upright ones at the right of the plots, or below these."""
    for place, (bar, label) in enumerate(zip(parts.bars, parts.bar_labels, strict=True)):
        if parts.side:
            row, column = divmod(place, parts.bars_beside)
            left, low = parts.left + column * _BAR_ROOM, top - (row + 1) * _BAR_STEP + _BAR_FOOT
            draw_colour_bar(page, (left, low, 0.16, _BAR_HEIGHT), bar, label)
        else:
            left = _LEFT + place * (parts.bar_width + _BETWEEN)
            draw_colour_bar(page, (left, top - 0.2, parts.bar_width, _BAR_THICK), bar, label)


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


def _with_plane_notes(drawing: Drawing) -> list[Note]:
    """The notes, and in the first one of phrases what each kind of mark of a plane shows."""
    found: dict[type, tuple[Phrase, ...]] = {}
    for mark in (mark for plot in drawing.plots for mark in plot.marks):
        if isinstance(mark, PlaneMark | Points) and not found.get(type(mark)):
            found[type(mark)] = plane_note(mark)
    phrases = tuple(dict.fromkeys(phrase for note in found.values() for phrase in note))
    notes = list(drawing.notes)
    place = next((at for at, note in enumerate(notes) if not isinstance(note, str)), len(notes))
    notes[place : place + 1] = [(*(notes[place] if place < len(notes) else ()), *phrases)]
    return notes
