"""Which image files are read, and their largest size."""

from __future__ import annotations

from s2rstore.files.image_header import read_header

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm", ".pgm")
MAX_PIXELS = 1 << 25
"""Pixels of a source image: a frame of 8K video; decoded, 100 MB of 8-bit RGB."""


def declared_size(content: bytes) -> tuple[int, int]:
    """(height, width) in the header of an image file's first bytes.

    Raises ValueError if it is not an image or larger than `MAX_PIXELS`.
    """
    header = read_header(content)
    if header.pixels > MAX_PIXELS:
        raise ValueError(f"{header.width} x {header.height} pixels; at most {MAX_PIXELS:,} in all")
    return header.size
