"""A terminal that draws pictures by Kitty's protocol, as far as its bytes tell: what it holds."""

from __future__ import annotations

import re
from base64 import standard_b64decode
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np
from PIL import Image

from s2rtui.terminal.graphics.kitty_protocol import NUMBERS, PLACEHOLDER

QUESTION_END = b"\x1b[c"
ATTRIBUTES = b"\x1b[?62;22c"
CURSOR = b"\x1b[7;1R"
DRAWN = b"\x1b_Gi=31;OK\x1b\\"
CELL = b"\x1b[6;20;10t"
ANSWER = CURSOR + DRAWN + CURSOR + CELL + ATTRIBUTES
_COMMAND = re.compile(rb"\x1b_G([^;\x1b]*)(?:;([^\x1b]*))?\x1b\\")
_SHOWN = re.compile(rf"\x1b\[38;5;(\d+)m((?:{PLACEHOLDER}[{NUMBERS}]{{3}})+)")


@dataclass(frozen=True)
class Held:
    """A picture (h, w, 3) that was sent, and the box of columns and rows that it fills."""

    pixels: np.ndarray
    box: tuple[int, int]


@dataclass
class Kitty:
    """What a terminal holds after some bytes, by number, and the bytes of pictures that came."""

    held: dict[int, Held] = field(default_factory=dict)
    received: int = 0

    @classmethod
    def after(cls, raw: bytes) -> Kitty:
        kitty = cls()
        begun: dict[str, str] = {}
        data = b""
        for match in _COMMAND.finditer(raw):
            keys = dict(pair.split("=") for pair in match[1].decode().split(","))
            assert len(match[2] or b"") <= 4096
            data += match[2] or b""
            begun = begun or keys
            if keys.get("m") != "1":
                kitty._take(begun, data)
                begun, data = {}, b""
        return kitty

    def _take(self, keys: dict[str, str], data: bytes) -> None:
        number = int(keys["i"])
        if keys["a"] == "d":
            assert keys["d"] == "I"  # with the data, not only where it is shown
            self.held.pop(number, None)
        elif keys["f"] == "100":
            assert (keys["a"], keys["U"], keys["q"]) == ("T", "1", "2")
            self.received += len(data)
            pixels = np.asarray(Image.open(BytesIO(standard_b64decode(data))).convert("RGB"))
            self.held[number] = Held(pixels, (int(keys["c"]), int(keys["r"])))


def placed(raw: bytes) -> dict[int, set[tuple[int, int]]]:
    """The (column, row) of each picture's parts that were written, by its number."""
    found: dict[int, set[tuple[int, int]]] = {}
    for match in _SHOWN.finditer(raw.decode(errors="ignore")):
        cells = match[2].split(PLACEHOLDER)[1:]
        places = {(NUMBERS.index(cell[1]), NUMBERS.index(cell[0])) for cell in cells}
        (high,) = {NUMBERS.index(cell[2]) for cell in cells}
        found.setdefault(high << 24 | int(match[1]), set()).update(places)
    return found


def box_cells(columns: int, rows: int) -> set[tuple[int, int]]:
    """All the (column, row) of a box."""
    return {(column, row) for column in range(columns) for row in range(rows)}
