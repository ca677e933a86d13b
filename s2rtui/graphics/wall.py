"""The pictures that the terminal holds: each is sent once, and all are deleted in the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from secrets import choice

from textual.geometry import Region
from textual.strip import Strip

from s2rtui.canvas import Canvas, Plate, Size
from s2rtui.canvas.colour import Pixels
from s2rtui.graphics import tgp
from s2rtui.graphics.png import png
from s2rtui.graphics.probe import Graphics, cell_pixels
from s2rtui.graphics.strips import Span, with_spans
from s2rtui.widgets.wall import Hung

NUMBERS = 32
"""Pictures that the terminal holds at most; those shown are at most half of them."""
LARGEST = 256 * 256
"""Pixels of a picture at most: what frames have by default."""
HEAVIEST = 96 * 1024
"""Bytes of a picture's PNG at most, four thirds of it as sent; few photographs reach it."""

_SLIDING = 0.3
"""Seconds."""
_HIGH = range(1, 100)
"""Highest bytes of numbers, whose diacritics take two bytes each."""
_LOW = range(16, 240, NUMBERS)
"""Lowest bytes of numbers: colours that no terminal changes."""


@dataclass(frozen=True, slots=True)
class _Sent:
    """A picture that hangs: what it follows from with its sizes, its content and its number."""

    of: object
    digest: bytes
    number: int


class PictureWall:
    """Hangs the pictures of canvases; `write` sends text to the terminal."""

    def __init__(self, graphics: Graphics, write: Callable[[str], None]) -> None:
        self._graphics = graphics
        self._write = write
        # By chance: several programs share a terminal in the panes of a tmux.
        self._first = choice(_HIGH) << 24 | choice(_LOW)
        self._turn = 0
        self._hung: dict[tuple[str, int], _Sent] = {}
        self._sent: set[int] = set()

    def rest(self, view: str) -> float:
        """Pictures that follow a slider wait until it rests; all others have waited already."""
        return _SLIDING if view == "adjust" else 0.0

    def hang(self, view: str, canvas: Canvas, strips: list[Strip]) -> Hung:
        """The strips with the canvas' pictures in them; sends those that do not hang there yet."""
        spans: dict[int, list[Span]] = {}
        places = set()
        for index, plate in enumerate(canvas.plates):
            if max(plate.width, plate.height) > len(tgp.NUMBERS):
                continue
            number = self._number(view, index, plate)
            places.add((Region(plate.x, plate.y, plate.width, plate.height), number))
            for row in range(plate.height):
                codes = partial(tgp.placeholders, number, row)
                span = Span(plate.x, plate.x + plate.width, codes)
                spans.setdefault(plate.y + row, []).append(span)
        hung = [with_spans(strip, spans.get(y, ())) for y, strip in enumerate(strips)]
        return Hung(hung, frozenset(places))

    def _number(self, view: str, index: int, plate: Plate) -> int:
        """The number of a picture; where it is another than before, it is sent under a new one."""
        size, cells = (
            pixel_size(plate, cell_pixels(self._graphics.cell)),
            (plate.width, plate.height),
        )
        of, known = (plate.of, size, cells), self._hung.get((view, index))
        if known is not None and known.of == of:
            return known.number
        pixels = plate.pixels(size)
        digest = blake2b(pixels.tobytes() + repr((size, cells)).encode()).digest()
        if known is not None and known.digest == digest:
            number = known.number
        else:
            number = self._free()
            self._sent.add(number)
            picture = _light_png(plate, pixels)
            self._write(tgp.show(number, picture, cells, self._graphics.in_tmux))
        self._hung[view, index] = _Sent(of, digest, number)
        return number

    def _free(self) -> int:
        """The number that was shown longest ago: what is still on the screen stays whole."""
        shown = {sent.number for sent in self._hung.values()}
        while True:
            self._turn = (self._turn + 1) % NUMBERS
            if self._first + self._turn not in shown:
                return self._first + self._turn

    def take_down(self) -> None:
        """Delete all pictures."""
        if self._sent:
            self._write(tgp.forget(sorted(self._sent), self._graphics.in_tmux))
        self._hung.clear()
        self._sent.clear()


def pixel_size(plate: Plate, cell: Size) -> Size:
    """(height, width) to send: as the picture has, but not more than its box or `LARGEST` takes."""
    rows, columns = plate.shape
    box = plate.height * cell[1], plate.width * cell[0]
    share = min(1.0, box[0] / rows, box[1] / columns, (LARGEST / (rows * columns)) ** 0.5)
    return max(1, int(rows * share)), max(1, int(columns * share))


def _light_png(plate: Plate, pixels: Pixels) -> bytes:
    """Its pixels, or as much fewer as make it light enough."""
    picture, size = png(pixels), pixels.shape[:2]
    while len(picture) > HEAVIEST:
        share = 0.98 * (HEAVIEST / len(picture)) ** 0.5
        size = int(size[0] * share), int(size[1] * share)
        picture = png(plate.pixels(size))
    return picture
