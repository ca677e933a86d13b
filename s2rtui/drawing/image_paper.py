"""Draw images on a page, and beside or below them their colour bars, the table and the notes."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np

from s2rtui.canvas.colour import NO_DEPTH
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.heat_colours import Ramp
from s2rtui.drawing.image import is_image_ramp, ramp_colours
from s2rtui.drawing.image_cells import image_rows
from s2rtui.drawing.page import (
    LETTER,
    NARROW,
    Page,
    draw_colour_bar,
    label_with_unit,
    value_colours,
    wrapped_label,
)
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.plot_paper import draw_marks
from s2rtui.drawing.table_paper import LINE, draw_table, page_layout, table_inches

_LEFT, _RIGHT, _TITLE, _GAP, _FOOT = 0.42, 0.25, 0.25, 0.12, 0.2
"""Inches at the left and the right of images, above and between them, and below everything."""
_SIDE, _BESIDE = 2.8, 0.3
"""Width of bars, table and notes beside images, and the gap before them, inches."""
_BAR_HEIGHT, _BAR_WIDTH, _BAR_LABEL, _BAR_FOOT = 1.4, 1.3, 0.55, 0.55
"""Height and width of a colour bar, and what is above it and below it, inches."""
_LEAST = 0.4
"""Height of images in inches below which they are drawn alone."""
_SMALLEST_FONT = 6.5
"""Points of the smallest table."""
_LETTERS = 16
"""Letters of a line above a colour bar."""


@dataclass(frozen=True, slots=True)
class _Texts:
    """What stands beside or below images, in `width` inches from `left` on."""

    drawing: Drawing
    font: float
    left: float
    width: float

    def _letters(self, font: float) -> int:
        return max(12, int(self.width / (LETTER * font)))

    @property
    def table_font(self) -> float:
        """The largest font in which the table has all of its columns."""
        table, font = self.drawing.table, self.font
        while table is not None and font > _SMALLEST_FONT:
            if len(page_layout(table, self._letters(font)).columns) == len(table.columns):
                break
            font -= 0.5
        return font

    @property
    def bars(self) -> list[ColourBar]:
        notes = (note for note in self.drawing.notes if not isinstance(note, str))
        return [item for note in notes for item in note if isinstance(item, ColourBar)]

    @property
    def lines(self) -> list[str]:
        return [
            line
            for note in self.drawing.notes if isinstance(note, str)
            for line in textwrap.wrap(note, self._letters(self.font), subsequent_indent="    ")
        ]  # fmt: skip

    @property
    def table_height(self) -> float:
        table, font = self.drawing.table, self.table_font
        return 0.0 if table is None else table_inches(table, self._letters(font), font) + LINE

    @property
    def bar_height(self) -> float:
        return _BAR_LABEL + _BAR_HEIGHT + _BAR_FOOT if self.bars else 0.0

    @property
    def height(self) -> float:
        return self.bar_height + self.table_height + (len(self.lines) + 0.5) * LINE


def draw_images(page: Page, drawing: Drawing) -> None:
    """Draw images in their rows, as large as possible beside or above bars, table and notes.

    On pages where they would be very small, images are drawn alone.
    """
    rows = image_rows(drawing.plots)
    wide = page.inches[0]
    font = 8 if wide <= NARROW else 9
    below = _Texts(drawing, font, 0.25, wide - 0.25 - _RIGHT)
    beside = _Texts(drawing, font, wide - _SIDE - _RIGHT / 2, _SIDE)
    places = ((beside, _SIDE + _BESIDE, _FOOT), (below, 0.0, below.height + _FOOT))
    heights = [_image_height(page, rows, side, foot) for _, side, foot in places]
    texts: _Texts | None = beside if heights[0] >= heights[1] else below
    high = max(heights)
    if high < _LEAST or not (drawing.table or drawing.notes):
        texts, high = None, _image_height(page, rows, 0.0, _FOOT)
    shape = _shape(rows)
    across = high * shape[1] / shape[0]
    for row, plots in enumerate(rows):
        bottom = page.top - _TITLE - (row + 1) * high - row * _GAP
        for column, plot in enumerate(plots):
            left = _LEFT + column * (across + _GAP)
            axes = page.axes(left, bottom, across, high)
            axes.set_axis_off()
            draw_marks(axes, page, plot, (across, high))
            if row == 0 and plot.title:
                title = plot.title[0]
                page.text(left, bottom + high + 0.06, title.text, getattr(page.inks, title.ink),
                          11, va="bottom", fontweight="bold")  # fmt: skip
        centred = {"ha": "center", "va": "center", "rotation": 90}
        name = next(iter(plots[0].y.names), "")
        page.text(0.27, bottom + high / 2, name, page.inks.muted, 9, **centred)
    if texts is beside:
        right = _LEFT + len(rows[0]) * (across + _GAP) - _GAP + _BESIDE
        _draw_texts(page, _Texts(drawing, font, right, wide - right - _RIGHT / 2), page.top)
    elif texts is below:
        _draw_texts(page, below, bottom - LINE)


def _shape(rows: list[list[Plot]]) -> tuple[float, float]:
    """Height and width of the images in pixels."""
    x, y = rows[0][0].x, rows[0][0].y
    return abs(y.high - y.low), abs(x.high - x.low)


def _image_height(page: Page, rows: list[list[Plot]], side: float, foot: float) -> float:
    """The height of each image that leaves `side` inches at the right and `foot` at the bottom."""
    height, width = _shape(rows)
    down = (page.top - _TITLE - foot - _GAP * (len(rows) - 1)) / len(rows)
    right = side or _RIGHT
    across = (page.inches[0] - _LEFT - right - _GAP * (len(rows[0]) - 1)) / len(rows[0])
    return max(0.2, min(down, across * height / width))


def _draw_texts(page: Page, texts: _Texts, top: float) -> None:
    """Draw the colour bars beside each other, below them the table, and the notes that fit."""
    for place, bar in enumerate(texts.bars):
        _draw_bar(page, bar, texts.left + place * _BAR_WIDTH, top - _BAR_LABEL - _BAR_HEIGHT)
    y, table = top - texts.bar_height, texts.drawing.table
    if table is not None:
        low = y - texts.table_height
        draw_table(page, table, y, low, texts.table_font, texts.left, texts.width)
        y = low
    for line in texts.lines:
        y -= LINE
        if y > 0.05:
            page.text(texts.left, y, line, page.inks.muted, texts.font)


def _draw_bar(page: Page, bar: ColourBar, left: float, bottom: float) -> None:
    colours: Ramp = value_colours
    if is_image_ramp(bar.ramp):
        colours = ramp_colours(bar.ramp, value_colours)
    label = wrapped_label(label_with_unit(bar.label, bar.unit), _LETTERS)
    high = _BAR_HEIGHT - 0.14 * max(0, label.count("\n") - 1)
    draw_colour_bar(page, left, bottom, high, bar.scale, label, colours, bar.clipped)
    if bar.ramp == "depth":
        patch = page.axes(left, bottom - 0.3, 0.16, 0.16)
        patch.set_axis_off()
        patch.imshow(np.array([[NO_DEPTH]], dtype=np.uint8), aspect="auto")
        page.text(left + 0.24, bottom - 0.22, "no depth", page.inks.muted, 8, va="center")
