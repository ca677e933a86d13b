"""The pictures that the terminal holds: each is sent once, and all are deleted in the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from secrets import choice
from traceback import print_exception

from textual.geometry import Region
from textual.strip import Strip

from s2rtui.canvas import Canvas, InlineImage, Size
from s2rtui.canvas.colour import Pixels
from s2rtui.jobs.background_thread import Lane, Tell
from s2rtui.terminal.graphics import kitty_protocol
from s2rtui.terminal.graphics.image_strips import Span, with_spans
from s2rtui.terminal.graphics.png import png
from s2rtui.terminal.graphics.probe import Graphics, cell_pixels
from s2rtui.terminal.image_host import PaintedStrips

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


Key = tuple[str, int]
"""A view, and which of its pictures."""


@dataclass(frozen=True, slots=True)
class _Wanted:
    """A picture to be made: what it follows from with its sizes, and the pixels to send of it."""

    key: Key
    plate: InlineImage
    size: Size
    of: object


@dataclass(frozen=True, slots=True)
class _Made:
    """A picture that is ready to be sent: its content, and the same as PNG."""

    of: object
    digest: bytes
    png: bytes


@dataclass(frozen=True, slots=True)
class _Sent:
    """A picture that hangs in a box of cells: its content and its number."""

    of: object
    cells: Size
    digest: bytes
    number: int


class KittyImageManager:
    """Hangs the pictures of canvases, which a thread per view makes: the newest request wins."""

    def __init__(
        self,
        graphics: Graphics,
        write: Callable[[str], None],
        ready: Callable[[], object],
        tell: Tell = print_exception,
    ) -> None:
        """`write` sends text to the terminal; `ready` hears, in another thread, that there are
        pictures to be hung; `tell` of what cannot be made.
        """
        self._graphics = graphics
        self._write = write
        self._ready, self._tell = ready, tell
        self._lanes: dict[str, Lane] = {}
        self._tickets: dict[str, list[tuple[Key, object]]] = {}
        self._made: dict[Key, _Made] = {}
        # By chance: several programs share a terminal in the panes of a tmux.
        self._first = choice(_HIGH) << 24 | choice(_LOW)
        self._turn = 0
        self._hung: dict[Key, _Sent] = {}
        self._sent: set[int] = set()

    def rest(self, view: str) -> float:
        """Pictures that follow a slider wait until it rests; all others have waited already."""
        return _SLIDING if view == "adjust" else 0.0

    def hang(self, view: str, canvas: Canvas, strips: list[Strip]) -> PaintedStrips:
        """The strips with the canvas' pictures in them; sends those that are made, has others made.

        Until then those that hung in their boxes stay.
        """
        spans: dict[int, list[Span]] = {}
        places, lacking = set(), []
        for index, plate in enumerate(canvas.images):
            if max(plate.width, plate.height) > len(kitty_protocol.NUMBERS):
                continue
            wanted = self._wanted((view, index), plate)
            number = self._number(wanted)
            hung = self._hung.get(wanted.key)
            if number is None:
                lacking.append(wanted)
                if hung is None or hung.cells != (plate.width, plate.height):
                    continue
                number = hung.number
            places.add((Region(plate.x, plate.y, plate.width, plate.height), number))
            for row in range(plate.height):
                codes = partial(kitty_protocol.placeholders, number, row)
                span = Span(plate.x, plate.x + plate.width, codes)
                spans.setdefault(plate.y + row, []).append(span)
        self._make(view, lacking)
        filled = [with_spans(strip, spans.get(y, ())) for y, strip in enumerate(strips)]
        return PaintedStrips(filled, frozenset(places))

    @property
    def idle(self) -> bool:
        """Whether no picture is being made, or is about to be."""
        return all(lane.idle for lane in self._lanes.values())

    def _wanted(self, key: Key, plate: InlineImage) -> _Wanted:
        size = pixel_size(plate, cell_pixels(self._graphics.cell))
        return _Wanted(key, plate, size, (plate.content_key, size, (plate.width, plate.height)))

    def _number(self, wanted: _Wanted) -> int | None:
        """The number of a picture that hangs or is ready; another than before has a new one."""
        key, known = wanted.key, self._hung.get(wanted.key)
        if known is not None and known.of == wanted.of:
            return known.number
        made = self._made.pop(key, None)
        if made is None or made.of != wanted.of:
            return None
        cells = wanted.plate.width, wanted.plate.height
        if known is not None and known.digest == made.digest:
            number = known.number
        else:
            number = self._free()
            self._sent.add(number)
            self._write(kitty_protocol.show(number, made.png, cells, self._graphics.in_tmux))
        self._hung[key] = _Sent(wanted.of, cells, made.digest, number)
        return number

    def _make(self, view: str, lacking: list[_Wanted]) -> None:
        """Have a view's pictures made, unless they are being made, in place of earlier ones."""
        ticket = [(wanted.key, wanted.of) for wanted in lacking]
        if ticket == self._tickets.get(view, []):
            return
        self._tickets[view] = ticket
        if not lacking:
            return
        if view not in self._lanes:
            self._lanes[view] = Lane(f"pictures of {view}", self._tell)

        def make() -> None:
            for wanted in lacking:
                made = _made(wanted)
                if self._tickets.get(view) is not ticket:
                    return
                self._made[wanted.key] = made
            self._ready()

        self._lanes[view].put(make)

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
            self._write(kitty_protocol.forget(sorted(self._sent), self._graphics.in_tmux))
        for kept in (self._hung, self._sent, self._made, self._tickets):
            kept.clear()


def pixel_size(plate: InlineImage, cell: Size) -> Size:
    """(height, width) to send: as the picture has, but not more than its box or `LARGEST` takes."""
    rows, columns = plate.shape
    box = plate.height * cell[1], plate.width * cell[0]
    share = min(1.0, box[0] / rows, box[1] / columns, (LARGEST / (rows * columns)) ** 0.5)
    return max(1, int(rows * share)), max(1, int(columns * share))


def _made(wanted: _Wanted) -> _Made:
    plate, size = wanted.plate, wanted.size
    pixels = plate.pixels(size)
    cells = plate.width, plate.height
    digest = blake2b(pixels.tobytes() + repr((size, cells)).encode()).digest()
    return _Made(wanted.of, digest, _light_png(plate, pixels))


def _light_png(plate: InlineImage, pixels: Pixels) -> bytes:
    """Its pixels, or as much fewer as make it light enough."""
    picture, size = png(pixels), pixels.shape[:2]
    while len(picture) > HEAVIEST:
        share = 0.98 * (HEAVIEST / len(picture)) ** 0.5
        size = int(size[0] * share), int(size[1] * share)
        picture = png(plate.pixels(size))
    return picture
