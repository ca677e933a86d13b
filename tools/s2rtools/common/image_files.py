"""Which image files are read, their largest size, and whether they are whole."""

from __future__ import annotations

import re

import simplejpeg

from s2rstore.files.image_header import ImageHeader, check_integrity, jpeg_segments, read_header

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff", ".ppm", ".pgm")
MAX_PIXELS = 1 << 25
"""Pixels of a source image: a frame of 8K video; decoded, 100 MB of 8-bit RGB."""
_JPEG_END = b"\xff\xd9"
_EXCESS = re.compile(r"(\d+) extraneous bytes before marker 0xd9")


def declared_size(content: bytes) -> tuple[int, int]:
    """(height, width) in the header of an image file's first bytes.

    Raises ValueError if it is not an image or larger than `MAX_PIXELS`.
    """
    header = read_header(content)
    if header.pixels > MAX_PIXELS:
        raise ValueError(f"{header.width} x {header.height} pixels; at most {MAX_PIXELS:,} in all")
    return header.size


def whole_image(content: bytes, header: ImageHeader) -> bytes:
    """The content of an image file, of a JPEG without the fill bytes around its end marker.

    Checksums of PNG are compared; a JPEG has to decode without a warning. Raises ValueError with
    the reason if the file is cut or damaged. Other damage of a JPEG cannot be detected, because the
    format has no checksum.
    """
    check_integrity(content, header)
    return _whole_jpeg(content, header) if header.format == "JPEG" else content


def _whole_jpeg(content: bytes, header: ImageHeader) -> bytes:
    scans = max(end for _, _, end in jpeg_segments(content))
    body = content[: content.find(_JPEG_END, scans)].rstrip(b"\xff")
    while warning := _jpeg_warning(body + _JPEG_END, header):
        # The decoder gives fill bytes before the end marker the same warning as damage.
        excess = _EXCESS.search(warning)
        count = int(excess[1]) if excess else 0
        if not count or body[-count:].strip(b"\0\xff"):
            raise ValueError(f"its compressed data is damaged ({warning})")
        body = body[:-count]
    return body + _JPEG_END


def _jpeg_warning(content: bytes, header: ImageHeader) -> str:
    """The first reason why a JPEG does not decode completely; empty if it does.

    An eighth of the size is decoded, which reads all compressed data in half of the time.
    """
    colours = "CMYK" if header.channels == 4 else "GRAY"
    try:
        simplejpeg.decode_jpeg(content, colours, min_height=1, min_width=1)
    except ValueError as error:
        return str(error)
    return ""
