"""Images by the Kitty protocol: each is sent once, placeholders show it, and all are deleted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Set
from functools import partial
from secrets import choice

from s2rtui.canvas import InlineImage, Size
from s2rtui.terminal.graphics import kitty_protocol
from s2rtui.terminal.graphics.image_strips import ImageSpan, uncovered
from s2rtui.terminal.graphics.png import png_within_limit, reduced_size

NUMBERS = 32
"""Images that the terminal holds at most; at most half of them are shown."""
_HIGH = range(1, 100)
"""Highest bytes of image numbers whose diacritics take two bytes each."""
_LOW = range(16, 240, NUMBERS)
"""Lowest bytes of image numbers: palette colours that no terminal changes."""


class KittyImages:
    """Implements `ImageProtocol`; the token of an image is its number."""

    over_text = False

    def __init__(self, write: Callable[[str], None], in_tmux: bool) -> None:
        """`write` sends text to the terminal."""
        self._write, self._in_tmux = write, in_tmux
        # Random, because the panes of a tmux session share one terminal.
        self._first = choice(_HIGH) << 24 | choice(_LOW)
        self._turn = 0
        self._numbers: set[int] = set()

    def fits(self, image: InlineImage) -> bool:
        """Whether the placeholders can number all cells of the image's box."""
        return max(image.width, image.height) <= len(kitty_protocol.NUMBERS)

    def size(self, image: InlineImage, cell: Size) -> Size:
        """The image's own size, at most the size of its box; the terminal scales it."""
        return reduced_size(image, cell)

    def encode(self, image: InlineImage, size: Size) -> bytes:
        """The image as PNG."""
        return png_within_limit(image, size)

    def show(self, content: bytes, cells: Size, shown: Set[object]) -> int:
        """Send the image under a number that is not shown."""
        number = self._free(shown)
        self._numbers.add(number)
        self._write(kitty_protocol.show(number, content, cells, self._in_tmux))
        return number

    def spans(self, token: object, image: InlineImage) -> Iterator[tuple[int, ImageSpan]]:
        """The placeholders of each row, between cells of text."""
        assert isinstance(token, int)
        for row in range(image.height):
            for start, end in uncovered(image, row):
                codes = partial(kitty_protocol.placeholders, token, row)
                yield row, ImageSpan(image.x + start, image.x + end, codes, start)

    def delete_all(self) -> None:
        """Delete all images from the terminal."""
        if self._numbers:
            self._write(kitty_protocol.forget(sorted(self._numbers), self._in_tmux))
            self._numbers.clear()

    def _free(self, shown: Set[object]) -> int:
        """The number that was shown longest ago, so that images on the screen stay whole."""
        while True:
            self._turn = (self._turn + 1) % NUMBERS
            if self._first + self._turn not in shown:
                return self._first + self._turn
