"""A terminal that draws pictures by Kitty's protocol, as far as its bytes tell: what it holds."""

from __future__ import annotations

import re
from base64 import standard_b64decode
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np
from PIL import Image

from s2rtui.graphics.tgp import NUMBERS, PLACEHOLDER

ANSWER = b"\x1b_Gi=31;OK\x1b\\\x1b[6;20;10t\x1b[?62;22c"
_COMMAND = re.compile(rb"\x1b_G([^;\x1b]*)(?:;([^\x1b]*))?\x1b\\")
_SHOWN = re.compile(rf"\x1b\[38;5;(\d+)m((?:{PLACEHOLDER}..)+)")


@dataclass
class Held:
    """A picture (h, w, 3) that was sent, and the box of columns and rows that it fills."""

    pixels: np.ndarray
    box: tuple[int, int]


@dataclass
class Kitty:
    """What a terminal holds after some bytes: by number, with every command that came."""

    held: dict[int, Held] = field(default_factory=dict)
    commands: list[dict[str, str]] = field(default_factory=list)
    sent: int = 0

    @classmethod
    def after(cls, raw: bytes) -> Kitty:
        kitty = cls()
        begun: dict[str, str] = {}
        data = b""
        for match in _COMMAND.finditer(raw):
            keys = dict(pair.split("=") for pair in match[1].decode().split(","))
            data += match[2] or b""
            begun = begun or keys
            if keys.get("m") == "1":
                continue
            kitty._take(begun, data)
            begun, data = {}, b""
        return kitty

    def _take(self, keys: dict[str, str], data: bytes) -> None:
        self.commands.append(keys)
        number = int(keys["i"])
        if keys["a"] == "d":
            self.held.pop(number, None)
        elif keys.get("f") == "100":
            self.sent += len(data)
            pixels = np.asarray(Image.open(BytesIO(standard_b64decode(data))).convert("RGB"))
            self.held[number] = Held(pixels, (int(keys["c"]), int(keys["r"])))


def placed(raw: bytes) -> dict[int, set[tuple[int, int]]]:
    """The (row, column) of each picture's parts that were written, by its number."""
    found: dict[int, set[tuple[int, int]]] = {}
    for match in _SHOWN.finditer(raw.decode(errors="replace")):
        cells = match[2].split(PLACEHOLDER)[1:]
        places = {(NUMBERS.index(cell[0]), NUMBERS.index(cell[1])) for cell in cells}
        found.setdefault(int(match[1]), set()).update(places)
    return found
