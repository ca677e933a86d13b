"""Encode PNG losslessly; images of few colours, such as depth, use a palette: half the bytes."""

from __future__ import annotations

import struct
from io import BytesIO
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from s2rtui.canvas import InlineImage, Pixels, Size
from s2rtui.terminal.graphics.sixel import PaletteImage, from_percent, quantised

MOST = 256
"""Colours of a palette at most."""
MAX_PIXELS = 256 * 256
"""Pixels of a photograph at most: the default size of frames."""
MAX_DRAWN_PIXELS = 1 << 20
"""Pixels at most of an image that is drawn for its box."""
MAX_BYTES = 96 * 1024
"""Bytes of a photograph's PNG at most; base64 makes it a third larger on the wire."""
MAX_DRAWN_BYTES = 4 * MAX_BYTES
"""Bytes of a drawing's PNG at most."""
_HEADER, _END = slice(16, 29), 33
"""The data of the header chunk, and its end."""
_COLOUR_TYPE, _PALETTE = 9, b"\x03"


def png(pixels: Pixels) -> bytes:
    """Encode an image (h, w, 3) uint8."""
    packed = pixels.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32)
    colours, places = np.unique(packed, return_inverse=True)
    if len(colours) > MOST:
        return _written(pixels)
    palette = np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=1)
    grey = _written(places.reshape(packed.shape).astype(np.uint8))
    return _coloured(grey, palette.astype(np.uint8).tobytes())


def palette_png(image: PaletteImage) -> bytes:
    """Encode an image that has a palette, sorted by brightness for PNG's filters."""
    grey = from_percent(image.palette) @ np.array([2, 5, 1])
    order = np.argsort(grey, kind="stable")
    place = np.empty(len(order), dtype=np.uint8)
    place[order] = np.arange(len(order))
    palette = from_percent(image.palette)[order]
    return _coloured(_written(place[image.indices]), palette.tobytes())


def reduced_size(image: InlineImage, cell: Size) -> Size:
    """(height, width) to send to a terminal that scales images.

    A photograph's own size is limited by its box of cells and by `MAX_PIXELS`, a drawing is as
    large as its box and has at most `MAX_DRAWN_PIXELS`. `cell`: (width, height) in pixels.
    """
    box = image.height * cell[1], image.width * cell[0]
    rows, columns = image.shape or box
    most = MAX_PIXELS if image.shape else MAX_DRAWN_PIXELS
    share = min(1.0, box[0] / rows, box[1] / columns, (most / (rows * columns)) ** 0.5)
    return max(1, int(rows * share)), max(1, int(columns * share))


def png_within_limit(image: InlineImage, size: Size) -> bytes:
    """Encode the image in `size` (height, width), reduced until it has at most `MAX_BYTES`.

    A drawing is quantised to a palette, which makes it four times smaller, and reduced until it
    has at most `MAX_DRAWN_BYTES`.
    """
    limit = MAX_BYTES if image.shape else MAX_DRAWN_BYTES

    def encoded(size: Size) -> bytes:
        pixels = image.pixels(size)
        return png(pixels) if image.shape else palette_png(quantised(pixels))

    content = encoded(size)
    while len(content) > limit:
        share = 0.98 * (limit / len(content)) ** 0.5
        size = max(1, int(size[0] * share)), max(1, int(size[1] * share))
        content = encoded(size)
    return content


def _written(values: NDArray[np.uint8]) -> bytes:
    stream = BytesIO()
    Image.fromarray(values).save(stream, format="PNG", compress_level=4)
    return stream.getvalue()


def _coloured(grey: bytes, palette: bytes) -> bytes:
    """Turn a grey PNG, whose values index a palette, into one with this palette.

    Pillow filters grey images by their neighbours but not palette images; these are as smooth.
    """
    header = grey[_HEADER]
    header = header[:_COLOUR_TYPE] + _PALETTE + header[_COLOUR_TYPE + 1 :]
    return grey[:8] + _chunk(b"IHDR", header) + _chunk(b"PLTE", palette) + grey[_END:]


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", crc32(name + data))
