"""Rasterization of the screen: lines of styled segments become pixels, cell by cell.

Box, block and braille characters are drawn as geometry, all others with DejaVu Sans Mono from
matplotlib. Equal lines give equal bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rich.cells import get_character_cell_size
from rich.color import Color, ColorType
from rich.segment import Segment
from rich.style import Style

from s2rstore.errors import RequestError
from s2rtui.canvas.colour import ANSI_16, DARK, Rgb, Theme
from s2rtui.canvas.glyph_masks import glyph_mask

ADVANCE = 0.602
"""Width of a character of DejaVu Sans Mono, in em."""
Mask = NDArray[np.uint8]
_BLANK = (" ", False)


@lru_cache(4)
def _font(bold: bool, cell_width: int) -> ImageFont.FreeTypeFont:
    spec = find_spec("matplotlib")
    if spec is None or not spec.submodule_search_locations:
        raise RequestError(
            "screenshots need the fonts of matplotlib; install it with `pip install matplotlib`"
        )
    name = "DejaVuSansMono-Bold.ttf" if bold else "DejaVuSansMono.ttf"
    folder = Path(spec.submodule_search_locations[0]) / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / name), size=cell_width / ADVANCE)


@lru_cache(8192)
def _glyph(char: str, bold: bool, height: int, width: int) -> Mask:
    """Return the coverage of one character, uint8 (height, width or twice that)."""
    cells = max(1, get_character_cell_size(char))
    drawn = glyph_mask(char, height, width * cells)
    if drawn is not None:
        return np.rint(drawn * 255).astype(np.uint8)
    font = _font(bold, width)
    picture = Image.new("L", (width * cells, height), 0)
    ascent, descent = font.getmetrics()
    baseline = (height - (ascent + descent)) / 2 + ascent
    advance = font.getlength(char)
    pen = ImageDraw.Draw(picture)
    pen.text(((width * cells - advance) / 2, baseline), char, fill=255, font=font, anchor="ls")
    return np.asarray(picture)


@lru_cache(65536)
def _rgb(color: Color | None, default: Rgb) -> Rgb:
    if color is None or color.type is ColorType.DEFAULT:
        return default
    if color.triplet is not None:
        return (color.triplet.red, color.triplet.green, color.triplet.blue)
    number = color.number or 0
    if number < 16:
        red, green, blue = (int(part) for part in ANSI_16[number])
        return (red, green, blue)
    triplet = color.get_truecolor()
    return (triplet.red, triplet.green, triplet.blue)


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

    def __init__(self, columns: int, rows: int, height: int, width: int, theme: Theme) -> None:
        self.height, self.width, self.theme = height, width, theme
        self.masks: list[Mask] = [np.zeros((height, width), dtype=np.uint8)]
        self.mask_numbers: dict[tuple[str, bool, int], int] = {(*_BLANK, 0): 0}
        self.index = np.zeros((rows, columns), dtype=np.intp)
        self.fg = np.full((rows, columns, 3), theme.text, dtype=np.uint8)
        self.bg = np.full((rows, columns, 3), theme.background, dtype=np.uint8)
        self.underlined = np.zeros((rows, columns), dtype=np.bool_)

    def mask(self, char: str, bold: bool, part: int) -> int:
        """Return the mask of a character's `part`: 0, or 1 for the right half of a wide one."""
        key = (char, bold and char != " ", part)
        if key not in self.mask_numbers:
            self.mask_numbers[key] = len(self.masks)
            ink = _glyph(char, bold, self.height, self.width)
            self.masks.append(ink[:, part * self.width : (part + 1) * self.width])
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
            at = round(self.height * 0.88)
            ink[underlined, at : at + max(1, self.width // 9)] = 255
        ink = ink.transpose(1, 0, 2)[..., None]
        low = self.bg[number].astype(np.int32)[None, :, None, :]
        high = self.fg[number].astype(np.int32)[None, :, None, :]
        mixed = low + ((high - low) * ink + 127) // 255
        return mixed.astype(np.uint8).reshape(self.height, -1, 3)


def rasterize(
    lines: Sequence[Iterable[Segment]],
    columns: int | None = None,
    theme: Theme = DARK,
    cell_width: int = 10,
    size: tuple[int, int] | None = None,
) -> Image.Image:
    """Draw lines (Textual strips or lists of rich segments) as an RGB image.

    A cell has `cell_width` x twice that many pixels; `theme` provides default colours; `columns`
    defaults to the longest line. `size` is the size of the image in pixels if it differs from that
    of the cells, which are then in its upper left.
    """
    rows = [list(line) for line in lines]
    if columns is None:
        columns = max((sum(part.cell_length for part in line) for line in rows), default=1)
    cells = max(1, columns), max(1, len(rows))
    grid = _CellGrid(*cells, 2 * cell_width, cell_width, theme)
    whole = cells[0] * cell_width, cells[1] * 2 * cell_width
    picture = Image.new("RGB", size or whole, theme.background)
    for row, line in enumerate(rows):
        grid.set_line(row, line)
    for row in range(cells[1]):  # row by row, because a large screen takes hundreds of MB
        picture.paste(Image.fromarray(grid.row_pixels(row), mode="RGB"), (0, row * 2 * cell_width))
    return picture


def rasterize_png(
    lines: Sequence[Iterable[Segment]],
    columns: int | None = None,
    theme: Theme = DARK,
    cell_width: int = 10,
    size: tuple[int, int] | None = None,
) -> bytes:
    """Return the image of `rasterize` as PNG bytes."""
    picture = rasterize(lines, columns, theme, cell_width, size)
    stream = BytesIO()
    picture.save(stream, format="PNG", compress_level=6)
    return stream.getvalue()
