"""Legends in cells: colour bars, scale bars and texts, arranged in rows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from rich.cells import cell_len

from s2rtui.canvas import Canvas, RenderOptions, Rgb, Theme, legible, turbo
from s2rtui.canvas.fit_text import fit_text
from s2rtui.drawing.heat_colours import Ramp
from s2rtui.drawing.scale import Range, short_number, tick_step

_SHORTEST_BAR = 4
"""Cells of a colour bar beside its label at least."""
_GAP = 2
"""Columns between parts."""
Piece = tuple[str, Rgb | None, Rgb | None]
"""A text, its colour and that of its ground; None for those of the canvas."""


@dataclass(frozen=True, slots=True)
class LegendPart:
    """A part of a legend: coloured texts, one after the other.

    is_text: whether it can be wrapped between words.
    """

    pieces: tuple[Piece, ...]
    is_text: bool = True

    @property
    def width(self) -> int:
        """Its length in cells."""
        return sum(cell_len(text) for text, *_ in self.pieces)

    def lines(self, width: int) -> list[LegendPart]:
        """The part in parts of at most `width` cells, which follow one another."""
        if self.width <= width or not self.is_text:
            return [self]
        lines = []
        for line in _wrapped(self.pieces, width):
            last, ink, ground = line[-1]
            lines.append(LegendPart((*line[:-1], (last.rstrip(), ink, ground))))
        return lines


def text_part(pieces: Sequence[tuple[str, Rgb]]) -> LegendPart:
    """A part of coloured texts."""
    return LegendPart(tuple((text, colour, None) for text, colour in pieces))


def _wrapped(pieces: Sequence[Piece], width: int) -> list[list[Piece]]:
    """Distribute texts over lines of at most `width` cells; only a longer word is cut.

    A single character, such as a glyph, stays before the word that it explains, and `NO_BREAK`
    joins two words.
    """
    words: list[list[Piece]] = [[]]
    for text, ink, ground in pieces:
        for word in re.findall(" *[^ ]+ *| +", text):
            words[-1].append((word, ink, ground))
            if cell_len(word.strip()) != 1:
                words.append([])
    lines: list[list[Piece]] = []
    free = -1
    for group in filter(None, words):
        needed = cell_len("".join(text for text, *_ in group).rstrip())
        if not lines or needed > free:
            lines.append([])
            free = width
        for word, ink, ground in group:
            shown = word if cell_len(word.rstrip()) <= width else fit_text(word, width)
            lines[-1].append((shown, ink, ground))
            free -= cell_len(shown)
    return lines


def role_legend(options: RenderOptions, **texts: str) -> LegendPart:
    """A part that explains the glyphs of roles such as "sim", each by a text."""
    pieces: list[tuple[str, Rgb]] = []
    for role, text in texts.items():
        glyph, colour = options.role(role)
        end = "" if role == list(texts)[-1] else "  "
        pieces += [(f"{glyph} ", colour), (text + end, options.theme.muted)]
    return text_part(pieces)


@lru_cache(64)
def colour_bar(
    label: str,
    unit: str,
    scale: Range,
    options: RenderOptions,
    length: int = 12,
    colours: Ramp = turbo,
    ramp: str | None = None,
    room: int | None = None,
    clipped: bool = False,
) -> tuple[LegendPart, ...]:
    """A part `label low [bar] high unit`; the bar is of colours, or of `ramp` without colours.

    If `clipped`, the ends are marked `p1` and `p99`: the 1st and the 99th percentile. To fit into
    `room` cells the bar shrinks first; then the label becomes a part of its own before the bar, and
    at last these marks are left out.
    """
    small, muted = 0.005 * max(abs(scale[0]), abs(scale[1])), options.theme.muted
    low, high = (short_number(0.0 if abs(end) < small else end, 2) for end in scale)
    first, last = ("p1 ", "p99 ") if clipped else ("", "")
    texts = (
        (f"{label} {first}{low} ".lstrip(), f" {last}{high} {unit}".rstrip()),
        (f"{first}{low} ", f" {last}{high} {unit}".rstrip()),
        (f"{low} ", f" {high} {unit}".rstrip()),
    )
    before, after = texts[0]
    if room is not None:
        widths = [sum(map(cell_len, pair)) for pair in texts]
        if label and widths[0] + _SHORTEST_BAR > room:
            bar = colour_bar("", unit, scale, options, length, colours, ramp, room, clipped)
            return text_part(((label, muted),)), *bar
        before, after = texts[1] if widths[1] + 2 <= room else texts[2]
        before, after = texts[0] if label else (before, after)
        length = max(1, min(length, room - cell_len(before) - cell_len(after)))
    shades = colours(np.linspace(0, 1, max(2, length)))
    is_plain = options.supports_images and ramp is None
    shown = shades if is_plain else legible(shades, options.theme)
    glyphs = ramp or options.glyphs.shades
    cells: list[Piece] = []
    for place, (red, green, blue) in enumerate(shown[:length].tolist()):
        glyph = glyphs[min(len(glyphs) - 1, place * len(glyphs) // length)]
        colour = red, green, blue
        cells.append((" ", None, colour) if is_plain else (glyph, colour, None))
    ends = (before, muted, None), (after, muted, None)
    return (LegendPart((ends[0], *cells, ends[1]), is_text=False),)


@lru_cache(64)
def scale_bar(metres_per_cell: float, room: int, options: RenderOptions) -> LegendPart:
    """A scale bar of a round length in metres, at most `room` cells long."""
    length = tick_step(metres_per_cell * room, 1)
    if length > metres_per_cell * room * (1 + 1e-9):
        length = tick_step(metres_per_cell * room / 2.5, 1)
    cells, glyphs = max(2, round(length / metres_per_cell)), options.glyphs
    bar = glyphs.scale_left + glyphs.horizontal * (cells - 2) + glyphs.scale_right
    label = f" {short_number(length)} m"
    pieces = (bar, options.theme.text, None), (label, options.theme.muted, None)
    return LegendPart(pieces, is_text=False)


def fit_rows(parts: Sequence[LegendPart], width: int) -> list[list[LegendPart]]:
    """Arrange parts in rows of at most `width` cells; wider texts are wrapped."""
    rows: list[list[LegendPart]] = []
    free = -1
    for part in (line for whole in parts for line in whole.lines(width)):
        if not rows or part.width + _GAP > free:
            rows.append([])
            free = width + _GAP
        rows[-1].append(part)
        free -= part.width + _GAP
    return rows


def cut_rows(
    rows: list[list[LegendPart]], width: int, most: int | None, options: RenderOptions
) -> list[list[LegendPart]]:
    """The first `most` rows; an ellipsis ends the last one where others are left out.

    Its last parts, or last words, make room for it.
    """
    kept = [list(row) for row in rows[:most]]
    if not kept or len(kept) == len(rows):
        return kept
    last = kept[-1]
    while len(last) > 1 and sum(part.width + _GAP for part in last) + 1 > width:
        last.pop()
    if last and last[0].width + _GAP + 1 > width:
        room = max(1, width - _GAP - 1)
        last[:] = last[0].lines(room)[:1] if last[0].is_text else []
    last.append(text_part(((options.glyphs.ellipsis, options.theme.muted),)))
    return kept


def draw_rows(canvas: Canvas, x: int, y: int, rows: Sequence[Sequence[LegendPart]]) -> None:
    """Draw rows of parts from (x, y) downwards."""
    for offset, row in enumerate(rows):
        at = x
        for part in row:
            for text, ink, ground in part.pieces:
                at = canvas.text(at, y + offset, text, ink, ground)
            at += _GAP


@lru_cache(4)
def point_colours(theme: Theme) -> Ramp:
    """The colours of points by value, 0 .. 1, as a theme shows them."""
    return lambda shares: legible(turbo(shares), theme)
