"""Check the entropy-coded data of a JPEG for damage that decoders ignore.

A JPEG has no checksum, and decoders fill unreadable parts with grey. This check follows every
Huffman code of every scan. An undamaged file has only known codes, no coefficient beyond the 64th,
plausible values, exactly the declared number of blocks, and then the next marker. A flipped bit
that changes a coefficient to another plausible value cannot be detected.
Source: ITU-T T.81, annexes B, F and G.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.numba_cache import njit

_SEQUENTIAL, _PROGRESSIVE = (0xC0, 0xC1), 0xC2
_DC_RANGE, _AC_RANGE = 1060.0, 1160.0
"""Largest magnitudes of dequantised coefficients: 1024 and 928 for 8-bit samples, with a margin
for encoders that overshoot to hide ringing."""
_MAX_PADDING = 64
"""Bytes of 0 or 255 between a scan and its marker; some cameras pad to a multiple."""
_REASONS = {
    1: "an unknown Huffman code", 2: "data that ends too early", 3: "a block of too many values",
    4: "implausible values", 5: "data behind the last block", 6: "a lost restart marker",
}  # fmt: skip


@dataclass(slots=True)
class _Component:
    across: int
    down: int
    table: int
    known: NDArray[np.uint8] | None = None


@dataclass(slots=True)
class _Frame:
    """Declarations of the segments before a scan."""

    quantisation: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    codes: dict[int, bytes] = field(default_factory=dict)
    components: dict[int, _Component] = field(default_factory=dict)
    width: int = 0
    height: int = 0
    restart: int = 0
    progressive: bool = False


def check_jpeg(content: bytes) -> None:
    """Raises ValueError with the reason if a JPEG's compressed data are damaged."""
    data = np.frombuffer(content, dtype=np.uint8)
    frame = _Frame()
    at, scans = 2, 0
    try:
        while True:
            at = _marker(content, at)
            marker = content[at - 1]
            if marker == 0xD9:
                break
            (length,) = struct.unpack_from(">H", content, at)
            segment = content[at + 2 : at + length]
            at += length
            if marker == 0xDA:
                at = _scan(data, at, frame, segment)
                scans += 1
            else:
                _declare(frame, marker, segment)
    except (IndexError, KeyError, struct.error) as error:
        raise ValueError("its compressed data is damaged (a lost marker or table)") from error
    if not scans:
        raise ValueError("it has no image data")


def _marker(content: bytes, at: int) -> int:
    """The position after the next marker, which only fill bytes may precede."""
    if content[at] != 0xFF:
        raise IndexError
    while content[at] == 0xFF:
        at += 1
    return at + 1


def _declare(frame: _Frame, marker: int, segment: bytes) -> None:
    if marker == 0xDB:
        while segment:
            wide, number = segment[0] >> 4, segment[0] & 15
            size = 128 if wide else 64
            steps = np.frombuffer(segment[1 : 1 + size], dtype=">u2" if wide else "u1")
            if steps.size != 64:
                raise IndexError
            frame.quantisation[number] = steps.astype(np.float64)
            segment = segment[1 + size :]
    elif marker == 0xC4:
        while segment:
            end = 17 + sum(segment[1:17])
            frame.codes[segment[0]] = segment[1:end]
            segment = segment[end:]
    elif marker == 0xDD:
        (frame.restart,) = struct.unpack_from(">H", segment)
    elif marker in (*_SEQUENTIAL, _PROGRESSIVE):
        frame.progressive = marker == _PROGRESSIVE
        bits, frame.height, frame.width, count = struct.unpack_from(">BHHB", segment)
        if bits != 8:
            raise ValueError(f"{bits} bits per sample are not read; save it with 8")
        for place in range(6, 6 + 3 * count, 3):
            name, sampling, table = segment[place : place + 3]
            across, down = sampling >> 4, sampling & 15
            if not (1 <= across <= 4 and 1 <= down <= 4):
                raise IndexError
            frame.components[name] = _Component(across, down, table)
    elif 0xC0 <= marker <= 0xCF:
        raise ValueError("its kind of JPEG is not read (arithmetic or lossless); save it as usual")


@lru_cache(maxsize=16)
def _lookups(*tables: bytes) -> NDArray[np.uint16]:
    """Per table and 16 bits of data: code length times 256 plus symbol; 0 for an unknown code."""
    return np.stack([_lookup(table) for table in tables])


def _lookup(table: bytes) -> NDArray[np.uint16]:
    lookup = np.zeros(1 << 16, dtype=np.uint16)
    code, place = 0, 16
    for length in range(1, 17 if table else 1):
        for _ in range(table[length - 1]):
            first = code << (16 - length)
            if first + (1 << (16 - length)) > lookup.size:
                raise IndexError
            lookup[first : first + (1 << (16 - length))] = length << 8 | table[place]
            code += 1
            place += 1
        code <<= 1
    return lookup


def _scan(data: NDArray[np.uint8], at: int, frame: _Frame, segment: bytes) -> int:
    """Check one scan; return the position of the marker after it."""
    count = segment[0]
    names = segment[1 : 1 + 2 * count : 2]
    tables = segment[2 : 2 + 2 * count : 2]
    first, last, approximation = segment[1 + 2 * count : 4 + 2 * count]
    before, shift = approximation >> 4, approximation & 15
    if not frame.progressive:
        first, last, before, shift = 0, 63, 0, 0
    if not (1 <= count <= 4) or first > last or last > 63 or (first and count > 1) or shift > 13:
        raise IndexError
    parts = [frame.components[name] for name in names]
    units, order = _units(frame, parts)
    specified = [frame.codes[table >> 4] if not first and not before else b"" for table in tables]
    specified += [frame.codes[16 | table & 15] if last else b"" for table in tables]
    codes = _lookups(*specified)
    scales = np.stack([frame.quantisation[part.table] for part in parts])
    known = np.zeros(0, dtype=np.uint8)
    if frame.progressive and first:
        if parts[0].known is None:
            parts[0].known = np.zeros(64 * units, dtype=np.uint8)
        known = parts[0].known
    if frame.progressive:
        band = np.array([first, last, before, shift])
        status, at = _walk(data, at, codes, scales, order, units, frame.restart, band, known)
    else:
        limits = np.floor(_AC_RANGE / scales + 1).astype(np.int64)
        limits[:, 0] = np.floor(_DC_RANGE / scales[:, 0] + 1)
        status, at = _walk_sequential(data, at, codes, limits, order, units, frame.restart)
    if status:
        raise ValueError(f"its compressed data is damaged ({_REASONS[int(status)]})")
    return int(at)


def _units(frame: _Frame, parts: list[_Component]) -> tuple[int, NDArray[np.int64]]:
    """Number of units of the scan, and the component of each block in a unit."""
    widest = max(part.across for part in frame.components.values())
    tallest = max(part.down for part in frame.components.values())
    if len(parts) == 1:
        width = math.ceil(frame.width * parts[0].across / widest)
        height = math.ceil(frame.height * parts[0].down / tallest)
        return math.ceil(width / 8) * math.ceil(height / 8), np.zeros(1, dtype=np.int64)
    units = math.ceil(frame.width / (8 * widest)) * math.ceil(frame.height / (8 * tallest))
    order = [number for number, part in enumerate(parts) for _ in range(part.across * part.down)]
    return units, np.array(order, dtype=np.int64)


@njit(cache=True, nogil=True)
def _fill(data, at, buffer, bits):
    """Read whole bytes until the buffer has more than 48 bits or a marker follows."""
    while bits <= 48 and at < data.size:
        value = data[at]
        if value == 255:
            if at + 1 >= data.size or data[at + 1] != 0:
                break
            at += 1
        at += 1
        buffer = (buffer << np.uint64(8)) | np.uint64(value)
        bits += 8
    return at, buffer, bits


@njit(cache=True, nogil=True)
def _next_code(table, buffer, bits):
    """Length times 256 plus symbol of the next code; 0 if unknown."""
    if bits >= 16:
        window = buffer >> np.uint64(bits - 16)
    else:
        missing = np.uint64(16 - bits)
        window = (buffer << missing) | ((np.uint64(1) << missing) - np.uint64(1))
    return table[np.int64(window & np.uint64(0xFFFF))]


@njit(cache=True, nogil=True)
def _take(buffer, bits, count):
    """The next `count` <= 16 bits as a number."""
    mask = (np.uint64(1) << np.uint64(count)) - np.uint64(1)
    return np.int64((buffer >> np.uint64(bits - count)) & mask)


@njit(cache=True, nogil=True)
def _take_signed(buffer, bits, size):
    """The next `size` <= 16 bits as a signed coefficient (T.81, figure F.12)."""
    value = _take(buffer, bits, size)
    if size and value < 1 << (size - 1):
        value -= (1 << size) - 1
    return value


@njit(cache=True, nogil=True)
def _skip_corrections(data, at, buffer, bits, known):
    """Skip the correction bit of each known coefficient; `bits` becomes -1 if data are missing."""
    for is_known in known:
        if is_known:
            if bits < 1:
                at, buffer, bits = _fill(data, at, buffer, bits)
                if bits < 1:
                    return at, buffer, -1
            bits -= 1
    return at, buffer, bits


@njit(cache=True, nogil=True)
def _walk_sequential(data, at, codes, limits, order, units, restart):
    """Follow all codes of a sequential scan; like `_walk`, but four times as fast.

    The valid `bits` of the buffer are at its upper end, followed by zeros.
    """
    parts = limits.shape[0]
    sums = np.zeros(parts, dtype=np.int64)
    buffer, bits = np.uint64(0), np.int64(0)
    marker = 0
    end = data.size
    for unit in range(units):
        if restart and unit and unit % restart == 0:
            if bits >= 8:
                return 5, at
            at, lost = _restart(data, at, marker)
            if lost:
                return 6, at
            marker = (marker + 1) % 8
            buffer, bits = np.uint64(0), np.int64(0)
            sums[:] = 0
        for place in range(order.size):
            part = order[place]
            k = np.int64(0)
            while k < 64:
                if bits < 32:
                    while bits <= 48 and at < end:
                        value = data[at]
                        if value == 255:
                            if at + 1 >= end or data[at + 1] != 0:
                                break
                            at += 1
                        at += 1
                        buffer |= np.uint64(value) << np.uint64(56 - bits)
                        bits += 8
                code = codes[part if k == 0 else parts + part, np.int64(buffer >> np.uint64(48))]
                if code == 0:
                    return 1 if bits >= 16 else 2, at
                length, size = np.int64(code >> 8), np.int64(code & 15)
                if k == 0:
                    if code & 255 > 11:
                        return 4, at
                else:
                    skip = np.int64(code >> 4) & 15
                    if size == 0:
                        if length > bits:
                            return 2, at
                        buffer <<= np.uint64(length)
                        bits -= length
                        if skip == 15:
                            k += 16
                            if k > 63:
                                return 3, at
                            continue
                        if skip:
                            return 1, at
                        break
                    k += skip
                    if k > 63:
                        return 3, at
                    if size > 10:
                        return 4, at
                if length + size > bits:
                    return 2, at
                buffer <<= np.uint64(length)
                coefficient = np.int64(0)
                if size:
                    coefficient = np.int64(buffer >> np.uint64(64 - size))
                    if coefficient < 1 << (size - 1):
                        coefficient -= (1 << size) - 1
                    buffer <<= np.uint64(size)
                bits -= length + size
                if k == 0:
                    sums[part] += coefficient
                    coefficient = sums[part]
                if coefficient > limits[part, k] or coefficient < -limits[part, k]:
                    return 4, at
                k += 1
    return _padding(data, at, buffer >> np.uint64(64 - bits) if bits else np.uint64(0), bits)


@njit(cache=True, nogil=True)
def _restart(data, at, marker):
    """The position after the expected restart marker, and whether the marker is missing."""
    while at + 1 < data.size and data[at] == 255 and data[at + 1] == 255:
        at += 1
    lost = at + 1 >= data.size or data[at] != 255 or data[at + 1] != 208 + marker
    return at + 2, lost


@njit(cache=True, nogil=True)
def _padding(data, at, buffer, bits):
    """Check the padding between the last block and the marker; return the marker's position."""
    count = 0
    while True:
        at, buffer, bits = _fill(data, at, buffer, bits)
        if bits < 8:
            return 0, at
        bits -= bits % 8
        value = _take(buffer, bits, 8)
        bits -= 8
        count += 1
        if count > _MAX_PADDING or (value != 0 and value != 255):
            return 5, at


@njit(cache=True, nogil=True)
def _walk(data, at, codes, scales, order, units, restart, band, known):
    """Follow all codes of a scan; return the reason of damage (0 = none) and the marker's position.

    `codes` holds the DC tables of the components, then their AC tables; `band` is first and last
    coefficient, previous and present bit shift. `known` marks nonzero coefficients.
    """
    first, last, before, shift = band
    parts = scales.shape[0]
    sums = np.zeros(parts, dtype=np.int64)
    buffer, bits = np.uint64(0), 0
    run = 0
    marker = 0
    for unit in range(units):
        if restart and unit and unit % restart == 0:
            at, buffer, bits = _fill(data, at, buffer, bits)
            if bits >= 8 or run:
                return 5, at
            at, lost = _restart(data, at, marker)
            if lost:
                return 6, at
            marker = (marker + 1) % 8
            buffer, bits = np.uint64(0), 0
            sums[:] = 0
        for place in range(order.size):
            part = order[place]
            k = first
            if k == 0:
                at, buffer, bits = _fill(data, at, buffer, bits)
                if before:
                    if bits < 1:
                        return 2, at
                    bits -= 1
                else:
                    code = _next_code(codes[part], buffer, bits)
                    if code == 0:
                        return 1, at
                    bits -= code >> 8
                    size = code & 255
                    if size > 11:
                        return 4, at
                    if bits < size:
                        return 2, at
                    sums[part] += _take_signed(buffer, bits, size)
                    bits -= size
                    scale = scales[part, 0]
                    if abs(sums[part] << shift) * scale > _DC_RANGE + scale * (1 << shift):
                        return 4, at
                k = 1
            while k <= last and not run:
                at, buffer, bits = _fill(data, at, buffer, bits)
                code = _next_code(codes[parts + part], buffer, bits)
                if code == 0:
                    return 1, at
                bits -= code >> 8
                if bits < 0:
                    return 2, at
                skip, size = (code >> 4) & 15, code & 15
                if size == 0 and skip < 15:
                    if skip and not first:
                        return 1, at
                    if bits < skip:
                        return 2, at
                    run = (1 << skip) + _take(buffer, bits, skip)
                    bits -= skip
                    break
                if before:
                    if size > 1:
                        return 4, at
                    if size:
                        if bits < 1:
                            return 2, at
                        bits -= 1
                    base = 64 * unit
                    while k <= last:
                        if known[base + k]:
                            if bits < 1:
                                at, buffer, bits = _fill(data, at, buffer, bits)
                                if bits < 1:
                                    return 2, at
                            bits -= 1
                        else:
                            if skip == 0:
                                break
                            skip -= 1
                        k += 1
                    if size:
                        if k > last:
                            return 3, at
                        known[base + k] = 1
                    k += 1
                    continue
                k += skip
                if k > last:
                    return 3, at
                if size:
                    if size > 10:
                        return 4, at
                    if bits < size:
                        return 2, at
                    value = _take_signed(buffer, bits, size)
                    bits -= size
                    scale = scales[part, k]
                    if abs(value << shift) * scale > _AC_RANGE + scale * (1 << shift):
                        return 4, at
                    if first:
                        known[64 * unit + k] = 1
                k += 1
            if run:
                run -= 1
                if before:
                    band_known = known[64 * unit + k : 64 * unit + last + 1]
                    at, buffer, bits = _skip_corrections(data, at, buffer, bits, band_known)
                    if bits < 0:
                        return 2, at
    if run:
        return 5, at
    return _padding(data, at, buffer, bits)
