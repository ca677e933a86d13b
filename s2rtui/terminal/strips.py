"""Convert a canvas to Textual strips: quantise colours, merge runs, cache styles and codes.

A strip encodes only the changes between its runs, which is a third of the bytes of plain segments.
A strip that is restyled falls back to plain segments.
"""

from __future__ import annotations

import unicodedata
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rich.cells import get_character_cell_size
from rich.color import Color, ColorSystem
from rich.segment import Segment
from rich.style import Style
from textual.color import Color as TextualColor
from textual.filter import LineFilter
from textual.geometry import Region
from textual.strip import Strip

from s2rtui.canvas import Canvas, ColourMode, Pixels, Rgb
from s2rtui.canvas.block_symbols import is_block
from s2rtui.canvas.canvas import BoolGrid
from s2rtui.canvas.colour import to_16, to_256
from s2rtui.terminal.textual_compat import LazyStrip

_DEFAULT = 1 << 24
_BOLD = 1 << 26


@dataclass(frozen=True, slots=True)
class Runs:
    """A row of cells: the start of each run and its colour codes (see `_codes`).

    text: one character per cell, NUL for the second cell of a wide one. starts: ascending, from 0.
    """

    text: str
    starts: list[int]
    inks: list[int]
    grounds: list[int]
    mode: ColourMode

    def parts(self) -> Iterator[tuple[str, int, int]]:
        """Text and colour codes of each run."""
        ends = [*self.starts[1:], len(self.text)]
        for start, end, ink, ground in zip(self.starts, ends, self.inks, self.grounds, strict=True):
            yield self.text[start:end].replace("\0", ""), ink, ground

    def cut(self, start: int, end: int) -> Runs:
        """The cells from `start` to `end`, which must not cut a wide character."""
        first, last = bisect_right(self.starts, start) - 1, bisect_left(self.starts, end)
        starts = [0, *(at - start for at in self.starts[first + 1 : last])]
        runs = slice(first, last)
        return Runs(self.text[start:end], starts, self.inks[runs], self.grounds[runs], self.mode)


class DeltaStrip(LazyStrip):
    """A strip of runs, whose escape codes hold only the changes between runs.

    A part that is cut out is a `DeltaStrip`, too.
    """

    __slots__ = ("runs",)

    def __init__(self, runs: Runs) -> None:
        self.runs = runs
        super().__init__(len(runs.text))

    def make_segments(self) -> list[Segment]:
        mode = self.runs.mode
        return [
            Segment(text, _style(ink % _BOLD, ground, ink >= _BOLD, mode))
            for text, ink, ground in self.runs.parts()
        ]

    def encode(self) -> str:
        return encoded(self.runs)

    def crop(self, start: int, end: int | None = None) -> Strip:
        text = self.runs.text
        start, end = max(0, start), len(text) if end is None else min(len(text), end)
        if start == 0 and end == len(text):
            return self
        if end <= start or text[start] == "\0" or text[end : end + 1] == "\0":
            return super().crop(start, end)
        return DeltaStrip(self.runs.cut(start, end))


@lru_cache(65536)
def _colour(code: int, mode: ColourMode) -> Color | None:
    if code == _DEFAULT:
        return None
    if mode is ColourMode.TRUECOLOR:
        return Color.from_rgb(code >> 16, code >> 8 & 255, code & 255)
    return Color.from_ansi(code)


@lru_cache(65536)
def _style(fg: int, bg: int, bold: bool, mode: ColourMode) -> Style:
    return Style(color=_colour(fg, mode), bgcolor=_colour(bg, mode), bold=bold or None)


@lru_cache(65536)
def _sgr(code: int, mode: ColourMode, background: bool) -> str:
    base = 48 if background else 38
    if code == _DEFAULT:
        return str(base + 1)
    if mode is ColourMode.TRUECOLOR:
        return f"{base};2;{code >> 16};{code >> 8 & 255};{code & 255}"
    if mode is ColourMode.PALETTE:
        return f"{base};5;{code}"
    return str(base - 8 + code if code < 8 else base + 44 + code)


@lru_cache(64)
def _exact(ground: Rgb, mode: ColourMode) -> int:
    """The code that the rest of the screen uses for its background, so that no seam shows."""
    red, green, blue = ground
    if mode is ColourMode.TRUECOLOR:
        return red << 16 | green << 8 | blue
    if mode is ColourMode.PALETTE:
        number = Color.from_rgb(red, green, blue).downgrade(ColorSystem.EIGHT_BIT).number
        return 16 if number is None else number
    return _DEFAULT


def _quantised(colours: Pixels, mode: ColourMode, ground: Pixels | None) -> NDArray[np.int64]:
    """(h, w, 3) to (h, w) codes; a colour equal to `ground` gets the code of the screen."""
    if mode is ColourMode.NONE:
        return np.full(colours.shape[:2], _DEFAULT, dtype=np.int64)
    if mode is ColourMode.PALETTE:
        codes = to_256(colours).astype(np.int64)
    elif mode is ColourMode.ANSI:
        codes = to_16(colours).astype(np.int64)
    else:
        steps = np.minimum((colours.astype(np.int64) + 2) & ~3, 255)
        codes = (steps[..., 0] << 16) | (steps[..., 1] << 8) | steps[..., 2]
    if ground is not None:
        codes[(colours == ground).all(axis=-1)] = _exact(tuple(ground.tolist()), mode)
    return codes


def merge_similar_colours(canvas: Canvas, tolerance: int) -> None:
    """Let neighbouring cells share the first colours of a run within `tolerance`.

    Only images change (block characters and blanks); in place, per channel, from left to right.
    """
    block = is_block(canvas.char)
    if tolerance <= 0 or not block.any():
        return
    image = block | (canvas.char == " ")
    both = np.concatenate([canvas.fg, canvas.bg], axis=-1).astype(np.int16)
    both[..., :3][~block] = 0
    start = both[:, 0].copy()
    empty = np.array(canvas.theme.background, dtype=np.uint8)
    ground = (canvas.bg == empty).all(axis=-1) & ((canvas.fg == empty).all(axis=-1) | ~block)
    joins = image[:, 1:] & image[:, :-1] & (block[:, 1:] == block[:, :-1])
    joins &= ground[:, 1:] == ground[:, :-1]  # an image keeps its edges
    for column in range(1, canvas.width):
        here = both[:, column]
        near = joins[:, column - 1] & (np.abs(here - start).max(axis=-1) <= tolerance)
        start = np.where(near[:, None], start, here)
        both[:, column] = start
    canvas.fg[block] = both[..., :3][block].astype(np.uint8)
    canvas.bg[image] = both[..., 3:][image].astype(np.uint8)


def _codes(canvas: Canvas, mode: ColourMode) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Foreground (with the bold bit) and background codes, (h, w) each.

    A blank takes the foreground of the glyph at its left, so that text does not break at spaces;
    a block character whose colours agree becomes a blank. Of 16 colours, glyphs get one that stands
    out from the background.
    """
    ground = np.array(canvas.theme.background, dtype=np.uint8)
    fg = _quantised(canvas.fg, mode, None)
    bg = _quantised(canvas.bg, mode, ground)
    block = is_block(canvas.char)
    if mode is ColourMode.ANSI:
        fg = np.where(block, fg, to_16(canvas.fg, canvas.theme.background))
    canvas.char[block & (fg == bg)] = " "
    fg = fg | (canvas.bold.astype(np.int64) * _BOLD)
    columns = np.arange(canvas.width)
    inked = (canvas.char != " ") & (canvas.char != "")
    last = np.maximum.accumulate(np.where(inked, columns, -1), axis=1)
    first = np.where(inked.any(axis=1), inked.argmax(axis=1), 0)[:, None]
    return np.take_along_axis(fg, np.where(last < 0, first, last), axis=1), bg


def to_strips(
    canvas: Canvas, mode: ColourMode, ascii: bool = False, tolerance: int = 0
) -> list[Strip]:
    """One strip per row. With `ascii`, other characters become "?". See `merge_similar_colours`."""
    drawn = Canvas(1, 1, canvas.options)
    drawn.char, drawn.bold = canvas.char.copy(), canvas.bold
    drawn.fg, drawn.bg = canvas.fg, canvas.bg
    if tolerance > 0:
        drawn.fg, drawn.bg = canvas.fg.copy(), canvas.bg.copy()
        merge_similar_colours(drawn, tolerance)
    fg, bg = _codes(drawn, mode)
    if ascii:
        drawn.char[(drawn.char > "~") & (drawn.char != "")] = "?"
    width = drawn.width
    text = drawn.char.tobytes().decode("utf-32-le")
    breaks = np.ones(fg.shape, dtype=np.bool_)
    breaks[:, 1:] = ((fg[:, 1:] != fg[:, :-1]) | (bg[:, 1:] != bg[:, :-1])) & (
        drawn.char[:, 1:] != ""
    )
    rows, columns = np.nonzero(breaks)
    bounds = np.searchsorted(rows, np.arange(drawn.height + 1)).tolist()
    starts, inks, grounds = (
        part.tolist() for part in (columns, fg[rows, columns], bg[rows, columns])
    )
    return [
        DeltaStrip(
            Runs(
                text[row * width : (row + 1) * width],
                starts[first:last],
                inks[first:last],
                grounds[first:last],
                mode,
            )
        )
        for row, (first, last) in enumerate(pairwise(bounds))
    ]


def encoded(runs: Runs) -> str:
    """A row with escape codes: all attributes for the first run, changes for the others."""
    mode = runs.mode
    codes: list[str] = []
    last_fg = last_bg = -1
    last_bold = False
    for part, code, ground in runs.parts():
        bold, ink = code >= _BOLD, code % _BOLD
        changes = []
        if bold != last_bold:
            changes.append("1" if bold else "22")
            last_bold = bold
        if ink != last_fg and not part.isspace():
            if ink != _DEFAULT or last_fg != -1:
                changes.append(_sgr(ink, mode, False))
            last_fg = ink
        if ground != last_bg:
            if ground != _DEFAULT or last_bg != -1:
                changes.append(_sgr(ground, mode, True))
            last_bg = ground
        codes.append(f"\x1b[{';'.join(changes)}m{part}" if changes else part)
    body = "".join(codes)
    return f"{body}\x1b[0m" if "\x1b" in body else body


@dataclass(frozen=True, slots=True)
class ImagePlace:
    """An inline image on the screen; equal images have equal tokens.

    `over_text`: whether the image lies on its cells, so that it must be drawn again where text
    disappears. `text` (rows, columns) marks cells of the region that show text, None for no cell.
    """

    region: Region
    token: object
    over_text: bool = False
    text: BoolGrid | None = field(default=None, compare=False)

    @property
    def text_cells(self) -> BoolGrid:
        """(rows, columns) of the region: the cells that show text."""
        if self.text is None:
            return np.zeros((self.region.height, self.region.width), dtype=np.bool_)
        return self.text


@dataclass(frozen=True, slots=True)
class PaintedStrips:
    """Strips that contain inline images, and the places of the images."""

    strips: list[Strip]
    places: frozenset[ImagePlace]


class ImageHost(Protocol):
    """Shows the inline images of a canvas."""

    def debounce_seconds(self, view: str) -> float:
        """Seconds without another drawing before the images of a view are sent."""

    def attach(self, view: str, canvas: Canvas, strips: list[Strip]) -> PaintedStrips:
        """Put the images of a canvas into its strips."""


_REPLACEMENTS = {
    "│": "|", "┃": "|", "▌": "|", "▐": "|", "▏": "|", "▎": "|", "▊": "|", "─": "-", "━": "-",
    "▁": "_", "▔": "-", "█": "#", "…": "~", "·": ".", "•": "*", "–": "-", "—": "-", "−": "-",
    "×": "x", "°": "d", "→": ">", "←": "<", "↑": "^", "↓": "v", "‘": "'", "’": "'", "“": '"',
    "”": '"',
}  # fmt: skip


def to_ascii(text: str) -> str:
    """Convert text to ASCII of the same width: drop accents, use `?` for other characters."""
    return text if text.isascii() else "".join(_character(char) for char in text)


@lru_cache(1024)
def _character(char: str) -> str:
    if char.isascii():
        return char
    width = get_character_cell_size(char)
    bare = unicodedata.normalize("NFKD", char)[:1]
    return _REPLACEMENTS.get(char, bare if bare.isascii() else "?").ljust(width, "?")[:width]


class AsciiFilter(LineFilter):
    """A Textual line filter that converts every line to ASCII."""

    def apply(self, segments: list[Segment], background: TextualColor) -> list[Segment]:
        return [Segment(to_ascii(text), style, control) for text, style, control in segments]
