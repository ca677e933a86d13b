"""Screenshots: the styled segments of the screen as text or, cell by cell, as pixels.

Box, block and braille characters are drawn as geometry, all others with DejaVu Sans Mono from
matplotlib. Equal lines give equal bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rich.cells import get_character_cell_size
from rich.color import Color, ColorType
from rich.segment import Segment
from rich.style import Style
from textual.screen import Screen

from s2rstore.errors import RequestError
from s2rtui.canvas import RenderOptions
from s2rtui.canvas.colour import ANSI_16, DARK, Rgb, Theme
from s2rtui.canvas.glyph_masks import glyph_mask
from s2rtui.terminal.textual_compat import screen_strips

WIDTH, HEIGHT = 10, 20
"""Size of a cell in pixels."""
_ADVANCE = 0.602
"""Width of a character of DejaVu Sans Mono, in em."""
Mask = NDArray[np.uint8]


@lru_cache(2)
def _font(bold: bool) -> ImageFont.FreeTypeFont:
    spec = find_spec("matplotlib")
    if spec is None or not spec.submodule_search_locations:
        raise RequestError(
            "screenshots need the fonts of matplotlib; install it with `pip install matplotlib`"
        )
    name = "DejaVuSansMono-Bold.ttf" if bold else "DejaVuSansMono.ttf"
    folder = Path(spec.submodule_search_locations[0]) / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / name), size=WIDTH / _ADVANCE)


@lru_cache(8192)
def _glyph(char: str, bold: bool) -> Mask:
    """Return the coverage of one character, uint8 (height, width or twice that)."""
    width = WIDTH * max(1, get_character_cell_size(char))
    drawn = glyph_mask(char, HEIGHT, width)
    if drawn is not None:
        return np.rint(drawn * 255).astype(np.uint8)
    font = _font(bold)
    image = Image.new("L", (width, HEIGHT), 0)
    ascent, descent = font.getmetrics()
    start = (width - font.getlength(char)) / 2, (HEIGHT - (ascent + descent)) / 2 + ascent
    ImageDraw.Draw(image).text(start, char, fill=255, font=font, anchor="ls")
    return np.asarray(image)


@lru_cache(65536)
def _rgb(color: Color | None, default: Rgb) -> Rgb:
    if color is None or color.type is ColorType.DEFAULT:
        return default
    if color.triplet is not None:
        return color.triplet
    number = color.number or 0
    if number < 16:
        red, green, blue = (int(part) for part in ANSI_16[number])
        return (red, green, blue)
    return color.get_truecolor()


@lru_cache(65536)
def _style_colours(style: Style | None, theme: Theme) -> tuple[Rgb, Rgb, bool, bool]:
    """Return foreground, background, bold and underline of a style."""
    if style is None:
        return theme.text, theme.background, False, False
    fg, bg = _rgb(style.color, theme.text), _rgb(style.bgcolor, theme.background)
    if style.reverse:
        fg, bg = bg, fg
    if style.dim:
        fg = (fg[0] + bg[0]) // 2, (fg[1] + bg[1]) // 2, (fg[2] + bg[2]) // 2
    return fg, bg, bool(style.bold), bool(style.underline)


class _CellGrid:
    """Cells of the screen: indices into a list of glyph masks, and colours."""

    def __init__(self, columns: int, rows: int, theme: Theme) -> None:
        self.theme = theme
        self.masks: list[Mask] = [np.zeros((HEIGHT, WIDTH), dtype=np.uint8)]
        self.mask_numbers: dict[tuple[str, bool, int], int] = {(" ", False, 0): 0}
        self.index = np.zeros((rows, columns), dtype=np.intp)
        self.fg = np.full((rows, columns, 3), theme.text, dtype=np.uint8)
        self.bg = np.full((rows, columns, 3), theme.background, dtype=np.uint8)
        self.underlined = np.zeros((rows, columns), dtype=np.bool_)

    def mask(self, char: str, bold: bool, part: int) -> int:
        """Return a character's index in `masks`; `part` is 1 for the right half of a wide one."""
        key = (char, bold and char != " ", part)
        if key not in self.mask_numbers:
            self.mask_numbers[key] = len(self.masks)
            self.masks.append(_glyph(char, bold)[:, part * WIDTH : (part + 1) * WIDTH])
        return self.mask_numbers[key]

    def set_line(self, row: int, segments: Iterable[Segment]) -> None:
        column, columns = 0, self.index.shape[1]
        for text, style, control in segments:
            if control:
                continue
            start = column
            fg, bg, bold, underline = _style_colours(style, self.theme)
            for char in text:
                size = get_character_cell_size(char)
                for part in range(size):
                    if column < columns:
                        self.index[row, column] = self.mask(char, bold, part)
                    column += 1
            span = slice(min(start, columns), min(column, columns))
            self.fg[row, span], self.bg[row, span] = fg, bg
            self.underlined[row, span] = underline

    def row_pixels(self, number: int) -> NDArray[np.uint8]:
        """Return the pixels (height, columns * width, 3) of one row of cells."""
        ink = np.stack([self.masks[index] for index in self.index[number]]).astype(np.int32)
        underlined = self.underlined[number]
        if underlined.any():
            ink[underlined, round(HEIGHT * 0.88)] = 255
        ink = ink.transpose(1, 0, 2)[..., None]
        low = self.bg[number].astype(np.int32)[None, :, None, :]
        high = self.fg[number].astype(np.int32)[None, :, None, :]
        mixed = low + ((high - low) * ink + 127) // 255
        return mixed.astype(np.uint8).reshape(HEIGHT, -1, 3)


def rasterize(
    lines: Sequence[Iterable[Segment]], theme: Theme = DARK, size: tuple[int, int] | None = None
) -> Image.Image:
    """Draw lines (Textual strips or lists of rich segments) as an RGB image.

    `theme` provides default colours. `size` is the size of the image in pixels if it differs from
    the size of the cells, which are then in its upper left.
    """
    rows = [list(line) for line in lines]
    columns = max((sum(part.cell_length for part in line) for line in rows), default=1)
    cells = max(1, columns), max(1, len(rows))
    grid = _CellGrid(*cells, theme)
    image = Image.new("RGB", size or (cells[0] * WIDTH, cells[1] * HEIGHT), theme.background)
    for row, line in enumerate(rows):
        grid.set_line(row, line)
    for row in range(cells[1]):  # row by row, because a large screen takes hundreds of MB
        image.paste(Image.fromarray(grid.row_pixels(row), mode="RGB"), (0, row * HEIGHT))
    return image


@dataclass(frozen=True, slots=True)
class Screenshot:
    """The lines of a screen as styled segments, taken on the UI thread and encoded anywhere."""

    lines: tuple[tuple[Segment, ...], ...]

    @classmethod
    def of(cls, screen: Screen[Any]) -> Screenshot:
        """Take the present content of a screen."""
        return cls(tuple(tuple(strip) for strip in screen_strips(screen)))

    @property
    def text(self) -> str:
        """The characters, without blanks at the ends of lines."""
        rows = ("".join(segment.text for segment in line).rstrip() for line in self.lines)
        return "\n".join(rows) + "\n"

    def png(self, options: RenderOptions, size: tuple[int, int] | None = None) -> bytes:
        """Encode as PNG, in the upper left of an image of `size` pixels if it is set."""
        stream = BytesIO()
        image = rasterize(self.lines, options.theme, size)
        image.save(stream, format="PNG", compress_level=6)
        return stream.getvalue()
