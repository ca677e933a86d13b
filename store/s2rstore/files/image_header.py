"""Format and size of an image file, read from its first bytes without decoding it.

Decoders allocate the size that a header declares, so sizes are checked before a file is decoded.
Formats are recognised by content, never by file name. Sources: PNG specification, ITU-T T.81,
TIFF 6.0, RFC 9649 (WebP), netpbm.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_bytes

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
JPEG_MAGIC = b"\xff\xd8\xff"
MOST_PLAN_PIXELS = 1 << 22
"""Pixels of a store's floor plan; ingest writes at most 1056 x 1056."""
MOST_PLAN_BYTES = 32 << 20
_MOST_SIDE = 100_000
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_TIFF_CODECS = {1: "none", 5: "LZW", 8: "deflate", 32773: "PackBits", 32946: "deflate"}
_TIFF_SIZES = {1: 1, 3: 2, 4: 4}
_MOST_SCANS = 100
"""Maximum scans of a progressive JPEG; encoders write about ten, each takes a pass to decode."""


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """Format, size in pixels, samples per pixel and bits per sample of an image file."""

    format: str
    width: int
    height: int
    channels: int
    bits: int

    @property
    def size(self) -> tuple[int, int]:
        """(height, width)"""
        return self.height, self.width

    @property
    def pixels(self) -> int:
        return self.width * self.height


def read_header(content: bytes) -> ImageHeader:
    """The header of a PNG, JPEG, TIFF, WebP, BMP, PGM or PPM file.

    Raises ValueError, in words for a user, for other formats, for files of several images and for
    headers that are damaged.
    """
    for magic, parse in _FORMATS:
        if content.startswith(magic):
            try:
                header = parse(content)
            except (struct.error, IndexError) as error:
                raise ValueError("its header is cut") from error
            if not (0 < header.width <= _MOST_SIDE and 0 < header.height <= _MOST_SIDE):
                raise ValueError(f"its header declares {header.width}x{header.height} pixels")
            return header
    raise ValueError("no PNG, JPEG, TIFF, WebP, BMP, PGM or PPM image")


def floor_plan_bytes(path: Path) -> bytes:
    """The content of a store's floor plan, a whole PNG of a size that can be displayed.

    Raises RequestError, before anything is decoded.
    """
    content = read_bytes(path, MOST_PLAN_BYTES)
    try:
        header = read_header(content)
        if header.format != "PNG":
            raise ValueError(f"a {header.format} image, not PNG")
        if header.pixels > MOST_PLAN_PIXELS:
            raise ValueError(f"{header.width}x{header.height} pixels are too many")
        check_integrity(content, header)
    except ValueError as error:
        raise RequestError(f"{path}: the floor plan is damaged ({error})") from error
    return content


def check_integrity(content: bytes, header: ImageHeader) -> None:
    """Raise ValueError where the file is cut, or one of its checksums does not match."""
    if header.format == "PNG":
        if next((kind for kind, _ in _png_chunks(content, check=True) if kind == b"IEND"), None):
            return
        raise ValueError("it ends before its end marker")
    if header.format == "JPEG":
        scans = max(end for _, _, end in jpeg_segments(content))
        if content.find(b"\xff\xd9", scans) < 0:
            raise ValueError("it ends before its end marker")
    if header.format == "WebP" and len(content) < 8 + struct.unpack_from("<I", content, 4)[0]:
        raise ValueError("it ends before its end")
    if header.format == "PNM":
        sample = 1 if header.bits == 8 else 2
        _, _, _, start = _pnm_fields(content)
        if len(content) - start < header.pixels * header.channels * sample:
            raise ValueError("it ends before its last pixel")


def _png(content: bytes) -> ImageHeader:
    width, height, bits, colour = struct.unpack_from(">IIBB", content, 16)
    if content[12:16] != b"IHDR" or colour not in _PNG_CHANNELS:
        raise ValueError("its header is damaged")
    for kind, _ in _png_chunks(content, check=False):
        if kind == b"acTL":
            raise ValueError("it is animated; save one image a file")
        if kind == b"IDAT":
            break
    return ImageHeader("PNG", width, height, _PNG_CHANNELS[colour], bits)


def _png_chunks(content: bytes, check: bool) -> Iterator[tuple[bytes, int]]:
    """Kind and position of each chunk; with `check` their checksums are compared, too."""
    view, at = memoryview(content), len(PNG_MAGIC)
    while at + 12 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, at)
        end = at + 12 + length
        if end > len(content):
            return
        if (
            check
            and zlib.crc32(view[at + 4 : end - 4]) != struct.unpack_from(">I", view, end - 4)[0]
        ):
            raise ValueError(f"chunk {kind.decode('ascii', 'replace')} does not fit its checksum")
        yield kind, at
        if kind == b"IEND":
            return
        at = end


def _jpeg(content: bytes) -> ImageHeader:
    header: ImageHeader | None = None
    for marker, start, end in jpeg_segments(content):
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            if header is not None:
                raise ValueError("its header declares two images")
            bits, height, width, channels = struct.unpack_from(">BHHB", content[start:end])
            header = ImageHeader("JPEG", width, height, channels, bits)
        if marker == 0xDA:
            break
    if header is None:
        raise ValueError("its header is damaged")
    if content.count(b"\xff\xda") > _MOST_SCANS:
        raise ValueError(f"it has more than {_MOST_SCANS} scans")
    return header


def jpeg_segments(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Marker, first byte and end of each segment's content, up to and with the first scan's."""
    at = 2
    while True:
        if content[at] != 0xFF:
            raise ValueError("its header is damaged")
        while content[at] == 0xFF:
            at += 1
        marker = content[at]
        at += 1
        if marker == 0x01 or 0xD0 <= marker <= 0xD7:
            continue
        if marker in (0x00, 0xD8, 0xD9):
            raise ValueError("its header is damaged")
        (length,) = struct.unpack_from(">H", content, at)
        if length < 2 or at + length > len(content):
            raise ValueError("its header is cut")
        yield marker, at + 2, at + length
        at += length
        if marker == 0xDA:
            return


def _tiff(content: bytes) -> ImageHeader:
    order = "<" if content[:2] == b"II" else ">"
    (at,) = struct.unpack_from(f"{order}I", content, 4)
    (count,) = struct.unpack_from(f"{order}H", content, at)
    tags: dict[int, tuple[int, int, int]] = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, number = struct.unpack_from(f"{order}HHI", content, entry)
        tags[tag] = kind, number, entry + 8
    (following,) = struct.unpack_from(f"{order}I", content, at + 2 + 12 * count)
    if following:
        raise ValueError("it holds several images; save one image a file")

    def values(tag: int, default: int) -> tuple[int, ...]:
        if tag not in tags:
            return (default,)
        kind, number, place = tags[tag]
        size = _TIFF_SIZES.get(kind)
        if size is None or not 0 < number <= len(content) // size:
            raise ValueError("its header is damaged")
        if size * number > 4:
            (place,) = struct.unpack_from(f"{order}I", content, place)
        return struct.unpack_from(f"{order}{number}{' BH I'[size]}", content, place)

    width, height = values(256, 0)[0], values(257, 0)[0]
    codec = values(259, 1)[0]
    if codec not in _TIFF_CODECS:
        raise ValueError(f"TIFF compression {codec} is not read; save it without, or with deflate")
    tile = values(322, 1)[0] * values(323, 1)[0]
    if tile > 4 * max(width * height, 1024 * 1024):
        raise ValueError("its tiles are larger than the image")
    for first, lengths in ((273, 279), (324, 325)):
        if first in tags and lengths in tags:
            ends = zip(values(first, 0), values(lengths, 0), strict=False)
            if any(start + length > len(content) for start, length in ends):
                raise ValueError("it ends before its last pixel")
    bits = values(258, 1)
    if len(set(bits)) > 1:
        raise ValueError("its channels have different depths")
    return ImageHeader("TIFF", width, height, values(277, 1)[0], bits[0])


def _webp(content: bytes) -> ImageHeader:
    if content[8:12] != b"WEBP":
        raise ValueError("no image")
    kind = content[12:16]
    if kind == b"VP8X":
        if content[20] & 2:
            raise ValueError("it is animated; save one image a file")
        width = int.from_bytes(content[24:27], "little") + 1
        height = int.from_bytes(content[27:30], "little") + 1
        return ImageHeader("WebP", width, height, 4 if content[20] & 16 else 3, 8)
    if kind == b"VP8L":
        packed = int.from_bytes(content[21:25], "little")
        return ImageHeader("WebP", (packed & 0x3FFF) + 1, (packed >> 14 & 0x3FFF) + 1, 4, 8)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return ImageHeader("WebP", width & 0x3FFF, height & 0x3FFF, 3, 8)
    raise ValueError("its header is damaged")


def _bmp(content: bytes) -> ImageHeader:
    (length,) = struct.unpack_from("<I", content, 14)
    if length < 40:
        width, height, _, bits = struct.unpack_from("<HHHH", content, 18)
    else:
        width, height, _, bits = struct.unpack_from("<iiHH", content, 18)
    return ImageHeader("BMP", width, abs(height), 1 if bits <= 8 else bits // 8, 8)


def _pnm(content: bytes) -> ImageHeader:
    width, height, highest, _ = _pnm_fields(content)
    channels = 1 if content[1:2] == b"5" else 3
    return ImageHeader("PNM", width, height, channels, 8 if highest < 256 else 16)


def _pnm_fields(content: bytes) -> tuple[int, int, int, int]:
    """Width, height, highest value and the first byte of the pixels."""
    at = 2
    fields: list[int] = []
    head = content[:4096]
    while len(fields) < 3:
        while head[at : at + 1].isspace():
            at += 1
        if head[at : at + 1] == b"#":
            at = head.index(b"\n", at) + 1
            continue
        end = at
        while head[end : end + 1].isdigit() and end - at < 10:
            end += 1
        if end == at:
            raise ValueError("its header is damaged")
        fields.append(int(head[at:end]))
        at = end
    width, height, highest = fields
    if not 0 < highest < 65536:
        raise ValueError("its header is damaged")
    return width, height, highest, at + 1


_FORMATS: tuple[tuple[bytes, Callable[[bytes], ImageHeader]], ...] = (
    (PNG_MAGIC, _png),
    (JPEG_MAGIC, _jpeg),
    (b"II*\0", _tiff),
    (b"MM\0*", _tiff),
    (b"RIFF", _webp),
    (b"BM", _bmp),
    (b"P5", _pnm),
    (b"P6", _pnm),
)
