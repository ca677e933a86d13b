"""Kitty's graphics protocol with Unicode placeholders: images are text, so clearing removes them.

Each image is sent once, and all are deleted at the end.

https://sw.kovidgoyal.net/kitty/graphics-protocol/#unicode-placeholders
"""

from __future__ import annotations

from base64 import standard_b64encode
from collections.abc import Callable, Iterable, Iterator, Set
from functools import partial
from secrets import choice

from s2rtui.canvas import InlineImage, Size
from s2rtui.terminal.graphics.image_strips import ImageSpan, uncovered
from s2rtui.terminal.graphics.reduced_png import png_within_limit, reduced_size

PLACEHOLDER = "\U0010eeee"
CHUNK = 4096
"""Characters of base64 per sequence, a limit of the protocol."""


def _spread(ranges: str) -> str:
    """The characters of hexadecimal code points and ranges."""
    ends = (part.split("-") for part in ranges.split())
    return "".join(chr(at) for end in ends for at in range(int(end[0], 16), int(end[-1], 16) + 1))


NUMBERS = _spread("""
    305 30D-30E 310 312 33D-33F 346 34A-34C 350-352 357 35B 363-36F 483-487 592-595 597-599
    59C-5A1 5A8-5A9 5AB-5AC 5AF 5C4 610-617 657-65B 65D-65E 6D6-6DC 6DF-6E2 6E4 6E7-6E8 6EB-6EC
    730 732-733 735-736 73A 73D 73F-741 743 745 747 749-74A 7EB-7F1 7F3 816-819 81B-823 825-827
    829-82D 951 953-954 F82-F83 F86-F87 135D-135F 17DD 193A 1A17 1A75-1A7C 1B6B 1B6D-1B73
    1CD0-1CD2 1CDA-1CDB 1CE0 1DC0-1DC1 1DC3-1DC9 1DCB-1DCC 1DD1-1DE6 1DFE 20D0-20D1 20D4-20D7
    20DB-20DC 20E1 20E7 20E9 20F0 2CEF-2CF1 2DE0-2DFF A66F A67C-A67D A6F0-A6F1 A8E0-A8F1 AAB0
    AAB2-AAB3 AAB7-AAB8 AABE-AABF AAC1 FE20-FE26 10A0F 10A38 1D185-1D189 1D1AA-1D1AD 1D242-1D244
""")
"""The diacritics for 0, 1, 2 ... above a placeholder: its row, then its column."""


def transmission(number: int, png: bytes, cells: Size, in_tmux: bool = False) -> str:
    """Send an image under a number; the terminal shows it wherever its placeholders are.

    The terminal scales it to the box `cells` (columns, rows).
    """
    data = standard_b64encode(png).decode("ascii")
    parts = [data[at : at + CHUNK] for at in range(0, len(data), CHUNK)]
    keys = f"a=T,U=1,f=100,i={number},c={cells[0]},r={cells[1]},q=2,"
    sent = []
    for index, part in enumerate(parts):
        more = int(index < len(parts) - 1)
        sent.append(command(f"{keys if index == 0 else ''}m={more};{part}", in_tmux))
    return "".join(sent)


def forget(numbers: Iterable[int], in_tmux: bool = False) -> str:
    """Delete images from the terminal."""
    return "".join(command(f"a=d,d=I,i={number},q=2", in_tmux) for number in numbers)


def command(text: str, in_tmux: bool = False) -> str:
    """One escape sequence, wrapped so that tmux passes it on if needed."""
    sequence = f"\x1b_G{text}\x1b\\"
    if not in_tmux:
        return sequence
    doubled = sequence.replace("\x1b", "\x1b\x1b")
    return f"\x1bPtmux;{doubled}\x1b\\"


def placeholders(number: int, row: int, column: int, count: int) -> str:
    """The placeholders of `count` cells of an image row.

    The lowest byte of the image number is encoded as text colour, the highest as a third diacritic;
    the bytes between are 0.
    """
    mark, high = f"{PLACEHOLDER}{NUMBERS[row]}", NUMBERS[number >> 24]
    cells = "".join(f"{mark}{NUMBERS[at]}{high}" for at in range(column, column + count))
    return f"\x1b[38;5;{number & 255}m{cells}\x1b[39m"


MOST_IMAGES = 32
"""Images that the terminal holds at most; at most half of them are shown."""
_HIGH = range(1, 100)
"""Highest bytes of image numbers whose diacritics take two bytes each."""
_LOW = range(16, 240, MOST_IMAGES)
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
        """Whether placeholders can address every cell of the image."""
        return max(image.width, image.height) <= len(NUMBERS)

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
        self._write(transmission(number, content, cells, self._in_tmux))
        return number

    def spans(self, token: object, image: InlineImage) -> Iterator[tuple[int, ImageSpan]]:
        """The placeholders of each row, between cells of text."""
        assert isinstance(token, int)
        for row in range(image.height):
            for start, end in uncovered(image, row):
                codes = partial(placeholders, token, row)
                yield row, ImageSpan(image.x + start, image.x + end, codes, start)

    def delete_all(self) -> None:
        """Delete all images from the terminal."""
        if self._numbers:
            self._write(forget(sorted(self._numbers), self._in_tmux))
            self._numbers.clear()

    def _free(self, shown: Set[object]) -> int:
        """The number that was shown longest ago, so that images on the screen stay whole."""
        while True:
            self._turn = (self._turn + 1) % MOST_IMAGES
            if self._first + self._turn not in shown:
                return self._first + self._turn
