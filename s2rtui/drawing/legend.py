"""Legends in cells: colour bars, scale bars and texts, arranged in rows."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from rich.cells import cell_len

from s2rtui.canvas import (
    DIGITS,
    Canvas,
    ColourMode,
    RenderOptions,
    Rgb,
    Theme,
    legible,
    turbo,
)
from s2rtui.canvas.fit_text import fit_text
from s2rtui.drawing.heat_colours import Ramp
from s2rtui.drawing.scale import Interval, short_number, tick_step

NO_BREAK = "\u00a0"
"""A blank at which texts are not wrapped, as between a number and its unit."""
_SHORTEST_BAR = 4
"""Cells of a colour bar beside its label at least."""


@dataclass(frozen=True, slots=True)
class LegendPart:
    """A part of a legend: its width in cells, and a function that draws it at (x, y).

    `wrap` splits it into parts of at most a width, which follow one another.
    """

    width: int
    draw: Callable[[Canvas, int, int], None]
    wrap: Callable[[int], list[LegendPart]] | None = None


def text_part(pieces: Sequence[tuple[str, Rgb]]) -> LegendPart:
    """A part of coloured texts, one after the other; it can be wrapped between words."""

    def draw(canvas: Canvas, x: int, y: int) -> None:
        for text, colour in pieces:
            x = canvas.text(x, y, text, colour)

    def wrap(width: int) -> list[LegendPart]:
        return [_text_line(line) for line in _wrapped(pieces, width)]

    return LegendPart(sum(cell_len(text) for text, _ in pieces), draw, wrap)


def _text_line(pieces: Sequence[tuple[str, Rgb]]) -> LegendPart:
    """A line of texts without the blanks at its end."""
    last, colour = pieces[-1]
    return text_part([*pieces[:-1], (last.rstrip(), colour)])


def _wrapped(pieces: Sequence[tuple[str, Rgb]], width: int) -> list[list[tuple[str, Rgb]]]:
    """Distribute texts over lines of at most `width` cells; only a longer word is cut.

    A single character, such as a glyph, stays before the word that it explains, and `NO_BREAK`
    joins two words.
    """
    words: list[list[tuple[str, Rgb]]] = [[]]
    for text, colour in pieces:
        for word in re.findall(" *[^ ]+ *| +", text):
            words[-1].append((word, colour))
            if cell_len(word.strip()) != 1:
                words.append([])
    lines: list[list[tuple[str, Rgb]]] = []
    free = -1
    for group in filter(None, words):
        needed = cell_len("".join(text for text, _ in group).rstrip())
        if not lines or needed > free:
            lines.append([])
            free = width
        for word, colour in group:
            shown = word if cell_len(word.rstrip()) <= width else fit_text(word, width)
            lines[-1].append((shown, colour))
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
    scale: Interval,
    options: RenderOptions,
    length: int = 12,
    colours: Ramp = turbo,
    ramp: str | None = None,
    room: int | None = None,
    clipped: bool = False,
) -> LegendPart:
    """A part `label low [bar] high unit`; the bar is of colours, or of `ramp` without colours.

    If `clipped`, the ends are marked `p1` and `p99`: the 1st and the 99th percentile. To fit into
    `room` cells the bar shrinks first; then the label gets lines of its own above the bar, and at
    last these marks are left out.
    """
    small = 0.005 * max(abs(scale[0]), abs(scale[1]))
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
            name = text_part(((label, options.theme.muted),))
            return LegendPart(
                cell_len(label) + 1 + bar.width,
                partial(_draw_beside, name, bar),
                lambda width: [*(name.wrap(width) if name.wrap else ()), bar],
            )
        before, after = texts[1] if widths[1] + 2 <= room else texts[2]
        before, after = texts[0] if label else (before, after)
        length = max(1, min(length, room - cell_len(before) - cell_len(after)))

    def draw(canvas: Canvas, x: int, y: int) -> None:
        x = canvas.text(x, y, before, options.theme.muted)
        shades = colours(np.linspace(0, 1, max(2, length)))
        plain = options.supports_images and ramp is None
        if not plain:
            shades = legible(shades, options.theme)
        glyphs = ramp or options.glyphs.shades
        for place in range(length):
            red, green, blue = (int(part) for part in shades[place])
            if plain:
                canvas.put(x + place, y, " ", bg=(red, green, blue))
            else:
                glyph = glyphs[min(len(glyphs) - 1, place * len(glyphs) // length)]
                canvas.put(x + place, y, glyph, (red, green, blue))
        canvas.text(x + length, y, after, options.theme.muted)

    return LegendPart(cell_len(before) + length + cell_len(after), draw)


def _draw_beside(first: LegendPart, second: LegendPart, canvas: Canvas, x: int, y: int) -> None:
    first.draw(canvas, x, y)
    second.draw(canvas, x + first.width + 1, y)


@lru_cache(64)
def scale_bar(metres_per_cell: float, room: int, options: RenderOptions) -> LegendPart:
    """A scale bar of a round length in metres, at most `room` cells long."""
    length = tick_step(metres_per_cell * room, 1)
    if length > metres_per_cell * room * (1 + 1e-9):
        length = tick_step(metres_per_cell * room / 2.5, 1)
    cells = max(2, round(length / metres_per_cell))
    glyphs, label = options.glyphs, f" {short_number(length)} m"

    def draw(canvas: Canvas, x: int, y: int) -> None:
        canvas.hline(x, x + cells - 1, y, glyphs.horizontal, options.theme.text)
        canvas.put(x, y, glyphs.scale_left, options.theme.text)
        canvas.put(x + cells - 1, y, glyphs.scale_right, options.theme.text)
        canvas.text(x + cells, y, label, options.theme.muted)

    return LegendPart(cells + cell_len(label), draw)


def fit_rows(
    parts: Sequence[LegendPart], width: int, gap: int = 2, most: int | None = None
) -> list[list[LegendPart]]:
    """Arrange parts in rows of at most `width` cells; wider parts are wrapped.

    An ellipsis ends the last one of `most` rows where parts are left out for want of rows.
    """
    rows: list[list[LegendPart]] = []
    free = -1
    for part in _wrapped_parts(parts, width):
        if not rows or part.width + gap > free:
            rows.append([])
            free = width + gap
        rows[-1].append(part)
        free -= part.width + gap
    return cut_rows(rows, width, most, gap)


def cut_rows(
    rows: list[list[LegendPart]], width: int, most: int | None, gap: int = 2
) -> list[list[LegendPart]]:
    """The first `most` rows; an ellipsis ends the last one where others are left out."""
    kept = rows[:most]
    if kept and len(kept) < len(rows):
        kept[-1] = _with_ellipsis(kept[-1], width, gap)
    return kept


def _wrapped_parts(parts: Sequence[LegendPart], width: int) -> Iterator[LegendPart]:
    for part in parts:
        if part.width <= width or part.wrap is None:
            yield part
        else:
            yield from part.wrap(width)


def _with_ellipsis(row: Sequence[LegendPart], width: int, gap: int) -> list[LegendPart]:
    """A row that ends with an ellipsis, for which its last parts, or last words, make room."""
    kept = list(row)
    while len(kept) > 1 and sum(part.width + gap for part in kept) + 1 > width:
        kept.pop()
    if kept and kept[0].width + gap + 1 > width:
        kept = kept[0].wrap(max(1, width - gap - 1))[:1] if kept[0].wrap else []

    def draw(canvas: Canvas, x: int, y: int) -> None:
        canvas.text(x, y, canvas.glyphs.ellipsis, canvas.theme.muted)

    return [*kept, LegendPart(1, draw)]


def draw_rows(
    canvas: Canvas, x: int, y: int, rows: Sequence[Sequence[LegendPart]], gap: int = 2
) -> None:
    """Draw rows of parts from (x, y) downwards."""
    for offset, row in enumerate(rows):
        at = x
        for part in row:
            part.draw(canvas, at, y + offset)
            at += part.width + gap


@lru_cache(4)
def point_colours(theme: Theme) -> Ramp:
    """The colours of points by value, 0 .. 1, as a theme shows them."""
    return lambda shares: legible(turbo(shares), theme)


def ramp_for_values(options: RenderOptions) -> str | None:
    """The digits that show values without colours or in ASCII, None otherwise."""
    return DIGITS if options.ascii or options.mode is ColourMode.NONE else None
