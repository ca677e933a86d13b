"""Inline images by the Kitty protocol: each is sent once, and all are deleted at the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from secrets import choice
from traceback import print_exception

from textual.geometry import Region
from textual.strip import Strip

from s2rtui.canvas import Canvas, InlineImage, Pixels, Size
from s2rtui.jobs.background_thread import LatestOnlyWorker, ReportError
from s2rtui.terminal.graphics import kitty_protocol
from s2rtui.terminal.graphics.image_strips import Span, with_spans
from s2rtui.terminal.graphics.png import png
from s2rtui.terminal.graphics.probe import Graphics, cell_pixels
from s2rtui.terminal.strips import PaintedStrips

NUMBERS = 32
"""Images that the terminal holds at most; at most half of them are shown."""
MAX_PIXELS = 256 * 256
"""Pixels of an image at most: the default size of frames."""
MAX_BYTES = 96 * 1024
"""Bytes of an image's PNG at most; base64 makes it a third larger on the wire."""

_SLIDER_DEBOUNCE = 0.3
"""Seconds."""
_HIGH = range(1, 100)
"""Highest bytes of image numbers whose diacritics take two bytes each."""
_LOW = range(16, 240, NUMBERS)
"""Lowest bytes of image numbers: palette colours that no terminal changes."""


Key = tuple[str, int]
"""A view and the index of its image."""


@dataclass(frozen=True, slots=True)
class _ImageRequest:
    """A requested image: its source, its cache key and the pixels to send."""

    key: Key
    image: InlineImage
    size: Size
    source: object


@dataclass(frozen=True, slots=True)
class _EncodedImage:
    """An encoded image with the digest of its content."""

    source: object
    digest: bytes
    png: bytes


@dataclass(frozen=True, slots=True)
class _ShownImage:
    """An image on the screen: its box of cells, content and number."""

    source: object
    cells: Size
    digest: bytes
    number: int


class KittyImageManager:
    """Shows images that one thread per view encodes; the newest request wins."""

    def __init__(
        self,
        graphics: Graphics,
        write: Callable[[str], None],
        on_ready: Callable[[], object],
        report_error: ReportError = print_exception,
    ) -> None:
        """`write` sends text to the terminal; `on_ready` is called in a thread when images are
        encoded, `report_error` when one cannot be.
        """
        self._graphics = graphics
        self._write = write
        self._on_ready, self._report_error = on_ready, report_error
        self._workers: dict[str, LatestOnlyWorker] = {}
        self._tickets: dict[str, list[tuple[Key, object]]] = {}
        self._encoded: dict[Key, _EncodedImage] = {}
        # Random, because the panes of a tmux session share one terminal.
        self._first = choice(_HIGH) << 24 | choice(_LOW)
        self._turn = 0
        self._shown: dict[Key, _ShownImage] = {}
        self._numbers: set[int] = set()

    def debounce_seconds(self, view: str) -> float:
        """Images of a moving slider wait until it stops; loaders debounce all others."""
        return _SLIDER_DEBOUNCE if view == "adjust" else 0.0

    def attach(self, view: str, canvas: Canvas, strips: list[Strip]) -> PaintedStrips:
        """Put the images of a canvas into its strips: send encoded ones, start encoding the others.

        Until then the previous images stay in their boxes.
        """
        spans: dict[int, list[Span]] = {}
        places, missing = set(), []
        for index, image in enumerate(canvas.images):
            if max(image.width, image.height) > len(kitty_protocol.NUMBERS):
                continue
            request = self._request((view, index), image)
            number = self._number(request)
            previous = self._shown.get(request.key)
            if number is None:
                missing.append(request)
                if previous is None or previous.cells != (image.width, image.height):
                    continue
                number = previous.number
            places.add((Region(image.x, image.y, image.width, image.height), number))
            for row in range(image.height):
                codes = partial(kitty_protocol.placeholders, number, row)
                span = Span(image.x, image.x + image.width, codes)
                spans.setdefault(image.y + row, []).append(span)
        self._encode_missing(view, missing)
        filled = [with_spans(strip, spans.get(y, ())) for y, strip in enumerate(strips)]
        return PaintedStrips(filled, frozenset(places))

    @property
    def idle(self) -> bool:
        """Whether no image is being encoded or is about to be."""
        return all(worker.idle for worker in self._workers.values())

    def _request(self, key: Key, image: InlineImage) -> _ImageRequest:
        size = pixel_size(image, cell_pixels(self._graphics.cell))
        return _ImageRequest(
            key, image, size, (image.content_key, size, (image.width, image.height))
        )

    def _number(self, request: _ImageRequest) -> int | None:
        """The number of an image that is shown or encoded; new content gets a new number."""
        key, shown = request.key, self._shown.get(request.key)
        if shown is not None and shown.source == request.source:
            return shown.number
        encoded = self._encoded.pop(key, None)
        if encoded is None or encoded.source != request.source:
            return None
        cells = request.image.width, request.image.height
        if shown is not None and shown.digest == encoded.digest:
            number = shown.number
        else:
            number = self._free()
            self._numbers.add(number)
            self._write(kitty_protocol.show(number, encoded.png, cells, self._graphics.in_tmux))
        self._shown[key] = _ShownImage(request.source, cells, encoded.digest, number)
        return number

    def _encode_missing(self, view: str, missing: list[_ImageRequest]) -> None:
        """Encode a view's images in its thread, in place of an earlier request."""
        ticket = [(request.key, request.source) for request in missing]
        if ticket == self._tickets.get(view, []):
            return
        self._tickets[view] = ticket
        if not missing:
            return
        if view not in self._workers:
            self._workers[view] = LatestOnlyWorker(f"images of {view}", self._report_error)

        def encode() -> None:
            for request in missing:
                encoded = _encode(request)
                if self._tickets.get(view) is not ticket:
                    return
                self._encoded[request.key] = encoded
            self._on_ready()

        self._workers[view].put(encode)

    def _free(self) -> int:
        """The number that was shown longest ago, so that images on the screen stay whole."""
        shown = {sent.number for sent in self._shown.values()}
        while True:
            self._turn = (self._turn + 1) % NUMBERS
            if self._first + self._turn not in shown:
                return self._first + self._turn

    def delete_all(self) -> None:
        """Delete all images from the terminal."""
        if self._numbers:
            self._write(kitty_protocol.forget(sorted(self._numbers), self._graphics.in_tmux))
        for cache in (self._shown, self._numbers, self._encoded, self._tickets):
            cache.clear()


def pixel_size(image: InlineImage, cell: Size) -> Size:
    """(height, width) to send: the image's own size, limited by its box and by `MAX_PIXELS`."""
    rows, columns = image.shape
    box = image.height * cell[1], image.width * cell[0]
    share = min(1.0, box[0] / rows, box[1] / columns, (MAX_PIXELS / (rows * columns)) ** 0.5)
    return max(1, int(rows * share)), max(1, int(columns * share))


def _encode(request: _ImageRequest) -> _EncodedImage:
    image, size = request.image, request.size
    pixels = image.pixels(size)
    cells = image.width, image.height
    digest = blake2b(pixels.tobytes() + repr((size, cells)).encode()).digest()
    return _EncodedImage(request.source, digest, _png_within_limit(image, pixels))


def _png_within_limit(image: InlineImage, pixels: Pixels) -> bytes:
    """Encode the image, reduced until it has at most `MAX_BYTES`."""
    encoded, size = png(pixels), pixels.shape[:2]
    while len(encoded) > MAX_BYTES:
        share = 0.98 * (MAX_BYTES / len(encoded)) ** 0.5
        size = int(size[0] * share), int(size[1] * share)
        encoded = png(image.pixels(size))
    return encoded
