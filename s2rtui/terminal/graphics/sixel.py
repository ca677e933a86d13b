"""Encode images as sixels: bands of six rows of pixels, up to 256 colours, run-length encoded.

https://vt100.net/docs/vt3xx-gp/chapter14.html
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from s2rtui.canvas import Pixels

BAND = 6
"""Rows of pixels of one character."""
MOST_COLOURS = 256
PERCENT = 100
"""Largest value of a channel in the palette."""
MOST_COLUMNS = 9999
"""Pixels of a row at most: repetition counts are written with four digits."""

_BLANK = ord("?")
"""The character of six unset pixels; the others follow in the order of their bits."""
_PREFIX, _RUN = 5, 6
"""Bytes of `$#255` (line and colour) and of `!9999~` (repetition) at most."""


@dataclass(frozen=True, slots=True, eq=False)
class PaletteImage:
    """indices: (h, w) uint8 into palette (n, 3) uint8 in percent, n <= `MOST_COLOURS`."""

    indices: NDArray[np.uint8]
    palette: NDArray[np.uint8]

    @property
    def pixels(self) -> Pixels:
        """(h, w, 3): the colours that a terminal shows."""
        return from_percent(self.palette)[self.indices]


def from_percent(channels: NDArray[np.uint8]) -> Pixels:
    """Convert channels from 0 .. 100 to 0 .. 255."""
    return ((channels.astype(np.uint16) * 255 + PERCENT // 2) // PERCENT).astype(np.uint8)


def quantised(pixels: Pixels) -> PaletteImage:
    """Reduce an image (h, w, 3) to a palette, without dithering.

    Channels are rounded to percent, an error of at most 2. Images of more than `MOST_COLOURS` such
    colours get a palette of their own.
    """
    percent = ((pixels.astype(np.uint16) * PERCENT + 127) // 255).astype(np.uint32)
    base = PERCENT + 1
    packed = (percent[..., 0] * base + percent[..., 1]) * base + percent[..., 2]
    occurs = np.zeros(base**3, dtype=np.bool_)
    occurs[packed] = True
    colours = np.flatnonzero(occurs)
    if len(colours) > MOST_COLOURS:
        return _reduced(pixels)
    number = np.zeros(base**3, dtype=np.uint8)
    number[colours] = np.arange(len(colours), dtype=np.uint8)
    palette = np.stack([colours // base**2, colours // base % base, colours % base], axis=1)
    return PaletteImage(number[packed], palette.astype(np.uint8))


def _reduced(pixels: Pixels) -> PaletteImage:
    """Take the palette of an octree, and for each pixel the colour nearest to its 6-bit channels.

    The octree's own choice of colours is coarser: mean error 3.2 in place of 2.7 on a floor plan.
    """
    octree = Image.fromarray(pixels).quantize(
        MOST_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
    )
    palette = np.array(octree.getpalette(), dtype=np.uint16).reshape(-1, 3)
    percent = ((palette * PERCENT + 127) // 255).astype(np.uint8)
    shown = from_percent(percent).astype(np.float32)
    wide = (pixels >> 2).astype(np.uint32)
    packed = wide[..., 0] << 12 | wide[..., 1] << 6 | wide[..., 2]
    occurs = np.zeros(1 << 18, dtype=np.bool_)
    occurs[packed] = True
    bins = np.flatnonzero(occurs)
    middle = (np.stack([bins >> 12, bins >> 6 & 63, bins & 63], axis=1) * 4 + 1.5).astype(
        np.float32
    )
    nearest = ((shown**2).sum(axis=1) - 2 * middle @ shown.T).argmin(axis=1)
    number = np.zeros(1 << 18, dtype=np.uint8)
    number[bins] = nearest
    return PaletteImage(number[packed], percent)


def sixels(image: PaletteImage) -> str:
    """The escape sequence that draws an opaque image from the cursor's cell.

    Raises ValueError for an image without pixels or with more than `MOST_COLUMNS` columns.
    """
    height, width = image.indices.shape
    if not height or not 0 < width <= MOST_COLUMNS:
        raise ValueError(f"an image of {width} x {height} pixels cannot be drawn in sixels")
    colours = "".join(
        f"#{number};2;{red};{green};{blue}"
        for number, (red, green, blue) in enumerate(image.palette.tolist())
    )
    body = _lines(image.indices, len(image.palette)).decode("ascii")
    return f'\x1bP0;1;0q"1;1;{width};{height}{colours}{body}\x1b\\'


def _lines(indices: NDArray[np.uint8], colours: int) -> bytes:
    """All bands: one line per colour of a band, in which a character is a column of six pixels."""
    height, width = indices.shape
    bands = -(-height // BAND)
    codes = np.full((bands * BAND, width), colours, dtype=np.intp)
    codes[:height] = indices
    held = np.zeros((bands, colours + 1), dtype=np.bool_)
    held[np.arange(bands * BAND)[:, None] // BAND, codes] = True
    held[:, colours] = False
    band, colour = np.nonzero(held)
    line = np.full(held.shape, len(band), dtype=np.intp)
    line[band, colour] = np.arange(len(band))
    bits = np.zeros((len(band) + 1, width), dtype=np.uint8)
    across, down = np.arange(width), np.arange(bands)[:, None]
    for row in range(BAND):
        bits[line[down, codes[row::BAND]], across] |= np.uint8(1 << row)
    return _runs(bits[:-1], band, colour)


def _runs(bits: NDArray[np.uint8], band: NDArray[np.intp], colour: NDArray[np.intp]) -> bytes:
    """Lines of six-pixel columns (n, width), run-length encoded; ascending by band."""
    width, flat = bits.shape[1], bits.ravel()
    begins = np.ones(flat.size, dtype=np.bool_)
    begins[1:] = flat[1:] != flat[:-1]
    begins[::width] = True
    start = np.flatnonzero(begins)
    length = np.diff(start, append=flat.size)
    value = flat[start]
    kept = (value > 0) | ((start + length) % width != 0)  # blanks at the end of a line
    start, length, value = start[kept], length[kept], value[kept]
    text = np.zeros((len(start), _PREFIX + _RUN), dtype=np.uint8)
    first = np.flatnonzero(start % width == 0)
    text[first, 0] = np.where(np.diff(band, prepend=0) > 0, ord("-"), ord("$"))
    text[first[:1], 0] = 0
    text[first, 1] = ord("#")
    text[first, 2:5] = _digits(colour, 3)
    letter = value + np.uint8(_BLANK)
    text[:, -1] = letter
    for times in (2, 3):
        text[:, -times] = np.where((length >= times) & (length <= 3), letter, 0)
    many = np.flatnonzero(length > 3)
    text[many, _PREFIX] = ord("!")
    text[many, _PREFIX + 1 : -1] = _digits(length[many], 4)
    return bytes(text[text != 0].tobytes())


def _digits(numbers: NDArray[np.intp], count: int) -> NDArray[np.uint8]:
    """(n, count): decimal digits, 0 in place of leading zeros."""
    powers = 10 ** np.arange(count - 1, -1, -1)
    shown = (numbers[:, None] >= powers) | (powers == 1)
    return np.where(shown, numbers[:, None] // powers % 10 + ord("0"), 0).astype(np.uint8)
