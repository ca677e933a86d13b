"""Masks of line, block and braille characters, exact to the pixel for any cell size.

A mask is (height, width) float32, 0 .. 1.
"""

from __future__ import annotations

import unicodedata

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas.block_symbols import symbol_pixels

Mask = NDArray[np.float32]

_WEIGHTS = {"LIGHT": 1, "HEAVY": 2, "SINGLE": 1, "DOUBLE": 3}
_ENDS = {
    "LEFT": ("left",),
    "RIGHT": ("right",),
    "UP": ("up",),
    "DOWN": ("down",),
    "HORIZONTAL": ("left", "right"),
    "VERTICAL": ("up", "down"),
}
_DASHES = {"DOUBLE DASH": 2, "TRIPLE DASH": 3, "QUADRUPLE DASH": 4}


def glyph_mask(char: str, height: int, width: int) -> Mask | None:
    """The mask of a box, block or braille character, None for any other."""
    code = ord(char) if len(char) == 1 else 0
    if 0x2800 <= code <= 0x28FF:
        return _braille(code - 0x2800, height, width)
    if char != " " and char in symbol_pixels():
        return _pixels(*symbol_pixels()[char], height, width)
    if 0x2580 <= code <= 0x259F:
        return _block(char, code, height, width)
    if 0x2500 <= code <= 0x257F:
        return _box(unicodedata.name(char).removeprefix("BOX DRAWINGS "), height, width)
    return None


def _braille(bits: int, height: int, width: int) -> Mask:
    mask = np.zeros((height, width), dtype=np.float32)
    size = max(1, min(round(width / 4), height // 8 + 1))
    places = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1))
    for bit, (row, column) in enumerate(places):
        if bits >> bit & 1:
            top = round((row + 0.5) * height / 4 - size / 2)
            left = round((column + 0.5) * width / 2 - size / 2)
            mask[max(0, top) : top + size, max(0, left) : left + size] = 1
    return mask


def _pixels(rows: int, columns: int, pattern: int, height: int, width: int) -> Mask:
    """The pixels of a pattern (see `s2rtui.canvas.block_symbols`)."""
    bits = (pattern >> np.arange(rows * columns) & 1).reshape(rows, columns)
    down, across = np.arange(height) * rows // height, np.arange(width) * columns // width
    return np.asarray(bits[down[:, None], across], dtype=np.float32)


def _block(char: str, code: int, height: int, width: int) -> Mask:
    mask = np.zeros((height, width), dtype=np.float32)
    if char in "░▒▓":
        mask[:] = {"░": 0.25, "▒": 0.5, "▓": 0.75}[char]
    elif char == "▔":
        mask[: max(1, round(height / 8))] = 1
    elif char == "▕":
        mask[:, width - max(1, round(width / 8)) :] = 1
    elif code <= 0x2588:  # lower eighths, ▁ .. █
        mask[height - max(1, round(height * (code - 0x2580) / 8)) :] = 1
    else:  # left eighths, ▉ .. ▏
        mask[:, : max(1, round(width * (0x2590 - code) / 8))] = 1
    return mask


def _box(name: str, height: int, width: int) -> Mask:
    mask = np.zeros((height, width), dtype=np.float32)
    if "DIAGONAL" in name:
        return _diagonal(name, height, width)
    for dash, count in _DASHES.items():
        if dash in name:
            return _dashed(name.replace(dash, ""), count, height, width)
    if "ARC" in name:
        return _arc(name, height, width)
    for end, weight in _arms(name).items():
        _arm(mask, end, weight)
    return mask


def _arms(name: str) -> dict[str, int]:
    """The edges of the cell that a character's lines reach, with their weights."""
    arms: dict[str, int] = {}
    weight = 1
    for part in name.split(" AND "):
        tokens = part.split()
        weight = next((_WEIGHTS[token] for token in tokens if token in _WEIGHTS), weight)
        for token in tokens:
            for end in _ENDS.get(token, ()):
                arms[end] = weight
    return arms


def _thickness(weight: int, width: int) -> int:
    thin = max(1, round(width / 9))
    return thin * 2 if weight == 2 else thin


def _arm(mask: Mask, end: str, weight: int) -> None:
    height, width = mask.shape
    thick = _thickness(weight, width)
    gaps = (-thick - 0.5, thick + 0.5) if weight == 3 else (0.0,)
    reach = thick / 2 + (thick + 0.5 if weight == 3 else 0)
    for gap in gaps:
        if end in ("left", "right"):
            top = round(height / 2 + gap - thick / 2)
            stop, start = round(width / 2 + reach), round(width / 2 - reach)
            columns = slice(0, stop) if end == "left" else slice(start, width)
            mask[top : top + thick, columns] = 1
        else:
            left = round(width / 2 + gap - thick / 2)
            stop, start = round(height / 2 + reach), round(height / 2 - reach)
            rows = slice(0, stop) if end == "up" else slice(start, height)
            mask[rows, left : left + thick] = 1


def _dashed(name: str, count: int, height: int, width: int) -> Mask:
    mask = np.zeros((height, width), dtype=np.float32)
    for end, weight in _arms(name).items():
        _arm(mask, end, weight)
    across = "HORIZONTAL" in name
    length = width if across else height
    phase = (np.arange(length) + 0.5) * count / length % 1
    gap = (phase < 0.2) | (phase > 0.8)
    if across:
        mask[:, gap] = 0
    else:
        mask[gap, :] = 0
    return mask


def _arc(name: str, height: int, width: int) -> Mask:
    """A quarter circle that joins the middles of two edges."""
    rows, columns = np.mgrid[0:height, 0:width] + 0.5
    thick = _thickness(1, width)
    middle = round(height / 2 - thick / 2) + thick / 2
    centre = round(width / 2 - thick / 2) + thick / 2
    down, right = (1 if "DOWN" in name else -1), (1 if "RIGHT" in name else -1)
    radius = width / 2
    along_y = (rows - middle) * down
    along_x = (columns - centre) * right
    corner = np.abs(np.hypot(along_x - radius, along_y - radius) - radius)
    distance = np.where((along_x <= radius) & (along_y <= radius), corner, np.inf)
    distance = np.where(along_y > radius, np.abs(along_x), distance)
    distance = np.where(along_x > radius, np.abs(along_y), distance)
    return np.clip(thick / 2 + 0.5 - distance, 0, 1).astype(np.float32)


def _diagonal(name: str, height: int, width: int) -> Mask:
    rows, columns = np.mgrid[0:height, 0:width] + 0.5
    mask = np.zeros((height, width), dtype=np.float32)
    slope = np.hypot(height, width)
    for mark, place in (("RIGHT TO", width - columns), ("LEFT TO", columns)):
        if mark in name or "CROSS" in name:
            distance = np.abs(place * height - rows * width) / slope
            mask = np.maximum(mask, np.clip(1.0 - distance + 0.2, 0, 1)).astype(np.float32)
    return mask
