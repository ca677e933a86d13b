"""Images by sixel and iTerm2's protocol, which draw over cells until text is written there.

An image is drawn with the first row of its box; the other rows skip its cells. So it is drawn again
wherever the compositor repaints that row, and text that replaces it removes it.
"""

from __future__ import annotations

from base64 import standard_b64encode
from collections.abc import Iterator, Set
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b

import numpy as np

from s2rtui.canvas import InlineImage, Size
from s2rtui.terminal.graphics.image_strips import ImageSpan, uncovered
from s2rtui.terminal.graphics.reduced_png import png_within_limit, reduced_size
from s2rtui.terminal.graphics.sixel import BAND, MOST_COLUMNS, quantised, sixels

MOST_CELLS = 1 << 16
"""Cells of an image at most; larger ones are drawn in cells."""

_SAVE, _RESTORE = "\x1b7", "\x1b8"
"""Save and restore the position of the cursor."""


@dataclass(frozen=True, slots=True)
class _Drawing:
    """The escape sequence that draws an image, and the digest of it and of its box."""

    digest: bytes
    codes: str

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Drawing) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)


class DrawnImages:
    """Implements the parts of `ImageProtocol` that both protocols share."""

    over_text = True

    def __init__(self, keeps_text: bool = True) -> None:
        """`keeps_text`: whether text can lie on an image without removing all of it."""
        self._keeps_text = keeps_text

    def fits(self, image: InlineImage) -> bool:
        """Whether the image can be drawn in reasonable time, with its text."""
        if image.width * image.height > MOST_CELLS:
            return False
        return self._keeps_text or image.text is None or not image.text.any()

    def show(self, content: bytes, cells: Size, shown: Set[object]) -> object:
        """The drawing; nothing is sent before its row is painted."""
        digest = blake2b(content + repr(cells).encode()).digest()
        return _Drawing(digest, content.decode("ascii"))

    def spans(self, token: object, image: InlineImage) -> Iterator[tuple[int, ImageSpan]]:
        """The drawing at the first cell of the box, and jumps over all cells without text."""
        assert isinstance(token, _Drawing)
        draw = partial(_draw, token.codes)
        yield 0, ImageSpan(image.x, image.x, draw)
        for row in range(image.height):
            for start, end in uncovered(image, row):
                yield row, ImageSpan(image.x + start, image.x + end, _skip, start)

    def delete_all(self) -> None:
        """The images disappear with the screen of the application."""


class SixelImages(DrawnImages):
    """Images in sixels at the resolution of the screen."""

    def size(self, image: InlineImage, cell: Size) -> Size:
        """All pixels of the box."""
        return image.height * cell[1], image.width * cell[0]

    def encode(self, image: InlineImage, size: Size) -> bytes:
        """The image without the last rows that fill no band, which would reach below its box.

        Columns beyond `MOST_COLUMNS` are left out, too.
        """
        rows = max(BAND, size[0] // BAND * BAND)
        pixels = np.ascontiguousarray(image.pixels(size)[:rows, :MOST_COLUMNS])
        return sixels(quantised(pixels)).encode("ascii")


class Iterm2Images(DrawnImages):
    """Images as PNG files, which the terminal scales."""

    def size(self, image: InlineImage, cell: Size) -> Size:
        """The image's own size, at most the size of its box."""
        return reduced_size(image, cell)

    def encode(self, image: InlineImage, size: Size) -> bytes:
        """The sequence with the PNG."""
        content = png_within_limit(image, size)
        return inline_file(content, (image.width, image.height)).encode("ascii")


def _draw(codes: str, first: int, count: int) -> str:
    return f"{_SAVE}{codes}{_RESTORE}"


def _skip(first: int, count: int) -> str:
    """Move the cursor to the right."""
    return f"\x1b[{count}C"


def inline_file(content: bytes, cells: Size) -> str:
    """The escape sequence that draws an image file over the box `cells` (columns, rows)."""
    data = standard_b64encode(content).decode("ascii")
    keys = (
        f"inline=1;size={len(content)};width={cells[0]};height={cells[1]};"
        "preserveAspectRatio=0;doNotMoveCursor=1"
    )
    return f"\x1b]1337;File={keys}:{data}\x07"
