"""Inline images: each view's are encoded in its thread, and shown by a protocol."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass
from traceback import print_exception
from typing import Protocol

from textual.geometry import Region
from textual.strip import Strip

from s2rtui.canvas import Canvas, InlineImage, Size
from s2rtui.jobs.background_thread import LatestOnlyWorker, ReportError
from s2rtui.terminal.graphics.drawn_images import Iterm2Images, SixelImages
from s2rtui.terminal.graphics.image_strips import ImageSpan, with_spans
from s2rtui.terminal.graphics.kitty import KittyImages
from s2rtui.terminal.graphics.protocols import Graphics
from s2rtui.terminal.strips import ImagePlace, PaintedStrips

_SLIDER_DEBOUNCE = 0.3
"""Seconds."""
_REST = 0.15
"""Seconds without a newer drawing until an image that takes another one's place is encoded."""


Key = tuple[str, int]
"""A view and the index of its image."""


class ImageProtocol(Protocol):
    """How a terminal is told to show images.

    `over_text`: whether images lie on the cells, so that cells from which text disappears need the
    whole image again.
    """

    over_text: bool

    def fits(self, image: InlineImage) -> bool:
        """Whether the terminal can show the image."""

    def size(self, image: InlineImage, cell: Size) -> Size:
        """(height, width) of the pixels to encode, for cells of (width, height) pixels."""

    def encode(self, image: InlineImage, size: Size) -> bytes:
        """Encode the image. Called in a thread."""

    def show(self, content: bytes, cells: Size, shown: Set[object]) -> object:
        """Return a token of an encoded image for a box of (columns, rows).

        `shown` holds the tokens of all images on the screen. Equal tokens show equal pixels.
        """

    def spans(self, token: object, image: InlineImage) -> Iterator[tuple[int, ImageSpan]]:
        """The codes of the image's box by row, counted from its first."""

    def delete_all(self) -> None:
        """Remove all images from the terminal."""


@dataclass(frozen=True, slots=True)
class _ImageRequest:
    """A requested image: its source, its cache key and the pixels to send."""

    key: Key
    image: InlineImage
    size: Size
    source: object


@dataclass(frozen=True, slots=True)
class _EncodedImage:
    """An encoded image."""

    source: object
    content: bytes


@dataclass(frozen=True, slots=True)
class _ShownImage:
    """An image on the screen: its box of cells, content and token."""

    source: object
    cells: Size
    content: bytes
    token: object


class ImageManager:
    """Shows images that one thread per view encodes; the newest request wins."""

    def __init__(
        self,
        graphics: Graphics,
        write: Callable[[str], None],
        on_ready: Callable[[], object],
        report_error: ReportError = print_exception,
        rest: float = _REST,
    ) -> None:
        """`write` sends text to the terminal; `on_ready` is called in a thread when images are
        encoded, `report_error` when one cannot be. `rest`: seconds until an image is replaced.

        Raises ValueError where the graphics have no protocol.
        """
        self._graphics = graphics
        self._protocol = _protocol(graphics, write)
        self._on_ready, self._report_error, self._rest = on_ready, report_error, rest
        self._workers: dict[str, LatestOnlyWorker] = {}
        self._tickets: dict[str, list[tuple[Key, object]]] = {}
        self._encoded: dict[Key, _EncodedImage] = {}
        self._shown: dict[Key, _ShownImage] = {}

    def debounce_seconds(self, view: str) -> float:
        """Images of a moving slider wait until it stops; loaders debounce all others."""
        return _SLIDER_DEBOUNCE if view == "adjust" else 0.0

    def attach(self, view: str, canvas: Canvas, strips: list[Strip]) -> PaintedStrips:
        """Put the images of a canvas into its strips: show encoded ones, start encoding the others.

        Until then the previous images stay in their boxes.
        """
        spans: dict[int, list[ImageSpan]] = {}
        places, missing = set(), []
        for index, image in enumerate(canvas.images):
            if not self._protocol.fits(image):
                continue
            request = self._request((view, index), image)
            token = self._token(request)
            if token is None:
                missing.append(request)
                previous = self._shown.get(request.key)
                if previous is None or previous.cells != (image.width, image.height):
                    continue
                token = previous.token
            region = Region(image.x, image.y, image.width, image.height)
            places.add(ImagePlace(region, token, self._protocol.over_text, image.text))
            for row, span in self._protocol.spans(token, image):
                spans.setdefault(image.y + row, []).append(span)
        self._encode_missing(view, missing)
        filled = [with_spans(strip, spans.get(y, ())) for y, strip in enumerate(strips)]
        return PaintedStrips(filled, frozenset(places))

    @property
    def idle(self) -> bool:
        """Whether no image is being encoded or is about to be."""
        return all(worker.idle for worker in self._workers.values())

    def _request(self, key: Key, image: InlineImage) -> _ImageRequest:
        size = self._protocol.size(image, self._graphics.cell_now())
        return _ImageRequest(
            key, image, size, (image.content_key, size, (image.width, image.height))
        )

    def _token(self, request: _ImageRequest) -> object:
        """The token of an image that is shown or encoded, else None."""
        key, shown = request.key, self._shown.get(request.key)
        if shown is not None and shown.source == request.source:
            return shown.token
        encoded = self._encoded.pop(key, None)
        if encoded is None or encoded.source != request.source:
            return None
        cells = request.image.width, request.image.height
        if shown is not None and (shown.content, shown.cells) == (encoded.content, cells):
            token = shown.token
        else:
            tokens = {other.token for other in self._shown.values()}
            token = self._protocol.show(encoded.content, cells, tokens)
        self._shown[key] = _ShownImage(request.source, cells, encoded.content, token)
        return token

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
        waits = any(
            request.image.shape is None and request.key in self._shown for request in missing
        )

        def encode() -> None:
            if waits:
                time.sleep(self._rest)
            for request in missing:
                if self._tickets.get(view) is not ticket:
                    return
                content = self._protocol.encode(request.image, request.size)
                if self._tickets.get(view) is not ticket:
                    return
                self._encoded[request.key] = _EncodedImage(request.source, content)
            self._on_ready()

        self._workers[view].put(encode)

    def delete_all(self) -> None:
        """Delete all images from the terminal."""
        self._protocol.delete_all()
        for cache in (self._shown, self._encoded, self._tickets):
            cache.clear()


def _protocol(graphics: Graphics, write: Callable[[str], None]) -> ImageProtocol:
    if graphics.protocol == "kitty":
        return KittyImages(write, graphics.in_tmux)
    if graphics.protocol == "iterm2":
        return Iterm2Images()
    if graphics.protocol == "sixel":
        return SixelImages(keeps_text=not graphics.in_tmux)
    raise ValueError(f"the terminal draws no images: {graphics.reason}")
