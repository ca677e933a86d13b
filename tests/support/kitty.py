"""Decode the Kitty graphics protocol: which images a terminal holds after receiving some bytes."""

from __future__ import annotations

import re
from base64 import standard_b64decode
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np
from PIL import Image

from s2rtui.terminal.graphics.kitty import NUMBERS, PLACEHOLDER

QUESTION_END = b"\x1b[c"
ATTRIBUTES = b"\x1b[?62;22c"
CURSOR_REPORT = b"\x1b[7;1R"
GRAPHICS_OK = b"\x1b_Gi=31;OK\x1b\\"
CELL_SIZE = b"\x1b[6;20;10t"
ANSWER = CURSOR_REPORT + GRAPHICS_OK + CURSOR_REPORT + CELL_SIZE + ATTRIBUTES
_COMMAND = re.compile(rb"\x1b_G([^;\x1b]*)(?:;([^\x1b]*))?\x1b\\")
_PLACEHOLDERS = re.compile(rf"\x1b\[38;5;(\d+)m((?:{PLACEHOLDER}[{NUMBERS}]{{3}})+)")


@dataclass(frozen=True)
class ReceivedImage:
    """A received image (h, w, 3) and the columns and rows of the box that it fills."""

    pixels: np.ndarray
    box: tuple[int, int]


@dataclass
class KittyTerminal:
    """The images that a terminal holds, by image number, and the bytes of image data received."""

    images: dict[int, ReceivedImage] = field(default_factory=dict)
    received: int = 0

    @classmethod
    def after(cls, raw: bytes) -> KittyTerminal:
        terminal = cls()
        pending_keys: dict[str, str] = {}
        data = b""
        for match in _COMMAND.finditer(raw):
            keys = dict(pair.split("=") for pair in match[1].decode().split(","))
            assert len(match[2] or b"") <= 4096
            data += match[2] or b""
            pending_keys = pending_keys or keys
            if keys.get("m") != "1":
                terminal._apply(pending_keys, data)
                pending_keys, data = {}, b""
        return terminal

    def _apply(self, keys: dict[str, str], data: bytes) -> None:
        number = int(keys["i"])
        if keys["a"] == "d":
            assert keys["d"] == "I"  # delete the data, not only the placements
            self.images.pop(number, None)
        elif keys["f"] == "100":
            assert (keys["a"], keys["U"], keys["q"]) == ("T", "1", "2")
            self.received += len(data)
            pixels = np.asarray(Image.open(BytesIO(standard_b64decode(data))).convert("RGB"))
            self.images[number] = ReceivedImage(pixels, (int(keys["c"]), int(keys["r"])))


def placed_cells(raw: bytes) -> dict[int, set[tuple[int, int]]]:
    """The (column, row) cells of each image that were written, by image number."""
    cells_of_image: dict[int, set[tuple[int, int]]] = {}
    for match in _PLACEHOLDERS.finditer(raw.decode(errors="ignore")):
        cells = match[2].split(PLACEHOLDER)[1:]
        positions = {(NUMBERS.index(cell[1]), NUMBERS.index(cell[0])) for cell in cells}
        (high,) = {NUMBERS.index(cell[2]) for cell in cells}
        cells_of_image.setdefault(high << 24 | int(match[1]), set()).update(positions)
    return cells_of_image


def box_cells(columns: int, rows: int) -> set[tuple[int, int]]:
    """All (column, row) cells of a box."""
    return {(column, row) for column in range(columns) for row in range(rows)}
