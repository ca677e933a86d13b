"""The canvas: character cells as one array per property."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len, get_character_cell_size

from s2rtui.canvas.colour import Pixels, Rgb
from s2rtui.canvas.fit_text import without_cut_numbers
from s2rtui.canvas.render_options import DEFAULT_OPTIONS, RenderOptions

Size = tuple[int, int]
BoolGrid = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class InlineImage:
    """An image that a terminal with graphics may draw in true pixels over its box of cells.

    `shape` is the source's (height, width), or None for a drawing that is made for its box;
    `pixels` renders it in any (height, width). `content_key` is equal only for equal pixels.
    `text` (height, width) marks cells that show their character in place of the image.
    """

    x: int
    y: int
    width: int
    height: int
    shape: Size | None
    pixels: Callable[[Size], Pixels]
    content_key: object
    text: BoolGrid | None = field(default=None, compare=False)


class Canvas:
    """`width` x `height` cells: `char` (h, w) '<U1', `fg` and `bg` (h, w, 3) uint8, `bold` (h, w).

    The cell after a character of width two holds the empty string. Drawing outside the canvas is
    clipped. Sizes below 1 become 1. `images` lists what a terminal may draw in true pixels.
    """

    __slots__ = ("bg", "bold", "char", "fg", "glyphs", "images", "options", "theme")

    def __init__(self, width: int, height: int, options: RenderOptions = DEFAULT_OPTIONS) -> None:
        shape = (max(1, int(height)), max(1, int(width)))
        self.options, self.theme, self.glyphs = options, options.theme, options.glyphs
        self.images: list[InlineImage] = []
        self.char: NDArray[np.str_] = np.full(shape, " ", dtype="<U1")
        self.fg: Pixels = np.empty((*shape, 3), dtype=np.uint8)
        self.bg: Pixels = np.empty((*shape, 3), dtype=np.uint8)
        self.bold: BoolGrid = np.zeros(shape, dtype=np.bool_)
        self.fg[:] = self.theme.text
        self.bg[:] = self.theme.background

    @property
    def width(self) -> int:
        return int(self.char.shape[1])

    @property
    def height(self) -> int:
        return int(self.char.shape[0])

    def lines(self) -> list[str]:
        """The characters of each row as a string."""
        width = self.width
        cells = np.ascontiguousarray(self.char).tobytes().decode("utf-32-le")
        rows = [cells[at : at + width] for at in range(0, len(cells), width)]
        return [row.replace("\0", "") for row in rows]

    def put(
        self,
        x: int,
        y: int,
        glyph: str,
        fg: Rgb | None = None,
        bg: Rgb | None = None,
        bold: bool = False,
    ) -> None:
        """Put one glyph of width one; colours that are None stay unchanged."""
        if 0 <= x < self.width and 0 <= y < self.height:
            char = self.char
            if not char.item(y, x):  # the second half of a wide character
                char[y, x - 1] = " "
            if x + 1 < self.width and not char.item(y, x + 1):
                char[y, x + 1] = " "
            char[y, x] = glyph
            self.bold[y, x] = bold
            if fg is not None:
                self.fg[y, x] = fg
            if bg is not None:
                self.bg[y, x] = bg

    def text(
        self,
        x: int,
        y: int,
        text: str,
        fg: Rgb | None = None,
        bg: Rgb | None = None,
        bold: bool = False,
        align: str = "left",
    ) -> int:
        """Write text from column `x`, up to it (align "right") or around it ("center").

        Control characters become spaces. Numbers that the canvas would show in part are left out.
        Returns the column after the text.
        """
        if not text.isprintable():
            text = "".join(letter if letter.isprintable() else " " for letter in text)
        length = cell_len(text)
        if align != "left":
            x -= length if align == "right" else length // 2
        if x < 0 or x + length > self.width:
            text = without_cut_numbers(text, -x, self.width)
        elif length and text.isascii() and 0 <= y < self.height:
            self._put_row(x, y, text, fg, bg, bold)
            return x + length
        for letter in text:
            size = get_character_cell_size(letter)
            if size == 0:
                continue
            if x + size <= self.width:
                self.put(x, y, letter, fg, bg, bold)
                if size == 2:
                    self.put(x + 1, y, "" if x >= 0 else " ", fg, bg, bold)
            x += size
        return x

    def _put_row(
        self, x: int, y: int, text: str, fg: Rgb | None, bg: Rgb | None, bold: bool
    ) -> None:
        """Put letters of width one that lie within a row."""
        stop = x + len(text)
        if not self.char.item(y, x):  # the second half of a wide character
            self.char[y, x - 1] = " "
        if stop < self.width and not self.char.item(y, stop):
            self.char[y, stop] = " "
        cells = y, slice(x, stop)
        self.char[cells] = list(text)
        self.bold[cells] = bold
        if fg is not None:
            self.fg[cells] = fg
        if bg is not None:
            self.bg[cells] = bg

    def hline(self, x0: int, x1: int, y: int, glyph: str = "─", fg: Rgb | None = None) -> None:
        """Draw a horizontal line from column `x0` to `x1`, both included."""
        start, stop = max(0, min(x0, x1)), min(self.width, max(x0, x1) + 1)
        if 0 <= y < self.height and start < stop:
            self._blank_halves(slice(y, y + 1), start, stop)
            self.char[y, start:stop] = glyph
            if fg is not None:
                self.fg[y, start:stop] = fg

    def vline(self, x: int, y0: int, y1: int, glyph: str = "│", fg: Rgb | None = None) -> None:
        """Draw a vertical line from row `y0` to `y1`, both included."""
        start, stop = max(0, min(y0, y1)), min(self.height, max(y0, y1) + 1)
        if 0 <= x < self.width and start < stop:
            self._blank_halves(slice(start, stop), x, x + 1)
            self.char[start:stop, x] = glyph
            if fg is not None:
                self.fg[start:stop, x] = fg

    def fill(self, x: int, y: int, width: int, height: int, bg: Rgb) -> None:
        """Fill a rectangle with a background colour."""
        rows = slice(max(0, y), max(0, y + height))
        columns = slice(max(0, x), max(0, x + width))
        self.bg[rows, columns] = bg

    def paste(self, other: Canvas, x: int, y: int) -> None:
        """Copy `other` with its top left corner to (x, y), clipped.

        Wide characters of which only one half would be seen become blanks.
        """
        left, top = max(0, x), max(0, y)
        right, bottom = min(self.width, x + other.width), min(self.height, y + other.height)
        if left >= right or top >= bottom:
            return
        into = (slice(top, bottom), slice(left, right))
        source = (slice(top - y, bottom - y), slice(left - x, right - x))
        self._blank_halves(into[0], left, right)
        self.char[into] = other.char[source]
        if left > x:
            halves = self.char[into[0], left] == ""
            self.char[into[0], left][halves] = " "
        if right < x + other.width:
            halves = other.char[source[0], right - x] == ""
            self.char[into[0], right - 1][halves] = " "
        self.bold[into] = other.bold[source]
        self.fg[into] = other.fg[source]
        self.bg[into] = other.bg[source]
        moved = (replace(image, x=image.x + x, y=image.y + y) for image in other.images)
        self.images += [image for image in moved if self._contains(image)]

    def _blank_halves(self, rows: slice, start: int, stop: int) -> None:
        """Blank the wide characters that lie partly in the columns from `start` to `stop`."""
        if start > 0:
            before = self.char[rows, start - 1]
            before[self.char[rows, start] == ""] = " "
        if stop < self.width:
            after = self.char[rows, stop]
            after[after == ""] = " "

    def show_text(self, cells: BoolGrid) -> None:
        """Let `cells` (height, width) of images show their characters in place of the image."""
        for index, image in enumerate(self.images):
            box = (slice(image.y, image.y + image.height), slice(image.x, image.x + image.width))
            if cells[box].any():
                text = cells[box] if image.text is None else image.text | cells[box]
                self.images[index] = replace(image, text=text)

    def _contains(self, image: InlineImage) -> bool:
        across = image.x >= 0 and image.x + image.width <= self.width
        return across and image.y >= 0 and image.y + image.height <= self.height
