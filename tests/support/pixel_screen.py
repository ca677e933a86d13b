"""Decode sixels and iTerm2's images: the pixels that a terminal shows after receiving some bytes.

Follows xterm: an image is drawn from the cursor's cell and lies on the cells; text that is written
to a cell, or erasing it, removes the image there. Written from the description of sixels in the
VT330/VT340 Programmer Reference Manual, chapter 14, and from iterm2.com/documentation-images.html.
"""

from __future__ import annotations

import re
from base64 import standard_b64decode
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rich.cells import cell_len

_TOKEN = re.compile(
    r"\x1bP(?P<dcs>[^\x1b]*)\x1b\\"
    r"|\x1b_(?P<apc>[^\x1b]*)\x1b\\"
    r"|\x1b\](?P<osc>[^\x07\x1b]*)(?:\x07|\x1b\\)"
    r"|\x1b\[(?P<csi>[<=>?]?[0-9;:]*[ !\"#$%&'()*+,\-./]*[@-~])"
    r"|\x1b(?P<esc>[^\[\]P_])"
    r"|(?P<text>[^\x00-\x1f\x7f]+)"
    r"|(?P<control>[\x00-\x1f\x7f])",
    re.DOTALL,
)
_SIXEL = re.compile(
    r"#(?P<register>\d+)(?:;2;(?P<rgb>\d+;\d+;\d+))?"
    r'|"(?P<raster>[\d;]+)|!(?P<times>\d+)(?P<repeated>[?-~])|(?P<single>[?-~])'
    r"|(?P<start>\$)|(?P<band>-)"
)


def decode_sixels(data: str) -> NDArray[np.int16]:
    """(h, w, 3) colours of `P1;P2;P3q...`, -1 where no pixel is set."""
    parameters, body = data.split("q", 1)
    assert parameters.split(";")[1] == "1"  # unset pixels stay
    raster = re.match(r'"1;1;(\d+);(\d+)', body)
    width, height = int(raster[1]), int(raster[2])
    pixels = np.full((-(-height // 6) * 6, width, 3), -1, dtype=np.int16)
    registers: dict[int, list[int]] = {}
    at = x = y = current = 0
    for match in _SIXEL.finditer(body):
        assert match.start() == at, body[at : at + 20]
        at = match.end()
        if match["register"]:
            current = int(match["register"])
            assert current < 256
            if match["rgb"]:
                percents = [int(part) for part in match["rgb"].split(";")]
                registers[current] = [(part * 255 + 50) // 100 for part in percents]
        elif match["start"]:
            x = 0
        elif match["band"]:
            x, y = 0, y + 6
        elif not match["raster"]:
            times, letter = int(match["times"] or 1), match["repeated"] or match["single"]
            for bit in range(6):
                if (ord(letter) - 63) >> bit & 1:
                    pixels[y + bit, x : x + times] = registers[current]
            x += times
            assert x <= width
    assert at == len(body)
    assert (pixels[height:] == -1).all()
    return pixels[:height]


@dataclass
class PixelScreen:
    """The pixels of images on a screen of (columns, rows), for cells of (width, height) pixels.

    pixels: (rows * height, columns * width, 3), -1 where no image is. `received` counts the images
    that arrived.
    """

    size: tuple[int, int]
    cell: tuple[int, int] = (10, 20)
    received: int = 0
    pixels: NDArray[np.int16] = field(init=False)

    def __post_init__(self) -> None:
        self._clear()
        self._column = self._row = 0
        self._saved = 0, 0

    def _clear(self) -> None:
        (columns, rows), (width, height) = self.size, self.cell
        self.pixels = np.full((rows * height, columns * width, 3), -1, dtype=np.int16)

    def feed(self, raw: bytes) -> PixelScreen:
        for match in _TOKEN.finditer(raw.decode(errors="replace")):
            if match["text"]:
                self._write(match["text"])
            elif match["csi"]:
                self._control(match["csi"])
            elif match["dcs"] and re.match(r"[\d;]*q", match["dcs"]):
                self._draw(decode_sixels(match["dcs"]))
            elif match["osc"] and match["osc"].startswith("1337;File="):
                self._file(match["osc"])
            elif match["esc"] == "7":
                self._saved = self._column, self._row
            elif match["esc"] == "8":
                self._column, self._row = self._saved
            elif match["control"] == "\n":
                self._row += 1
            elif match["control"] == "\r":
                self._column = 0
        return self

    def box(self, x: int, y: int, columns: int, rows: int) -> NDArray[np.int16]:
        """The pixels of a box of cells."""
        width, height = self.cell
        return self.pixels[y * height : (y + rows) * height, x * width : (x + columns) * width]

    def _write(self, text: str) -> None:
        count = cell_len(text)
        self.box(self._column, self._row, count, 1)[:] = -1
        self._column += count

    def _control(self, sequence: str) -> None:
        kind, numbers = sequence[-1], re.findall(r"\d+", sequence)
        first = int(numbers[0]) if numbers else 1
        if kind == "H":
            row, column = (int(part) for part in numbers) if len(numbers) == 2 else (1, 1)
            self._row, self._column = row - 1, column - 1
        elif kind == "C":
            self._column = min(self.size[0] - 1, self._column + first)
        elif kind in "ABD" and not sequence.startswith("?"):
            raise AssertionError(f"movement that is not decoded: {sequence!r}")
        elif kind == "J" or sequence in ("?1049h", "?1049l"):
            self._clear()
        elif kind == "K":
            self.box(self._column, self._row, self.size[0] - self._column, 1)[:] = -1

    def _draw(self, image: NDArray[np.int16]) -> None:
        self.received += 1
        width, height = self.cell
        top, left = self._row * height, self._column * width
        assert top + image.shape[0] <= self.pixels.shape[0], "the image scrolls the screen"
        assert left + image.shape[1] <= self.pixels.shape[1], "the image is wider than the screen"
        into = self.pixels[top : top + image.shape[0], left : left + image.shape[1]]
        into[image >= 0] = image[image >= 0]

    def _file(self, text: str) -> None:
        header, data = text.removeprefix("1337;File=").split(":", 1)
        keys = dict(part.split("=") for part in header.split(";"))
        content = standard_b64decode(data)
        assert (keys["inline"], keys["preserveAspectRatio"]) == ("1", "0")
        assert int(keys["size"]) == len(content)
        columns, rows = int(keys["width"]), int(keys["height"])
        box = columns * self.cell[0], rows * self.cell[1]
        picture = Image.open(BytesIO(content)).convert("RGB")
        resized = picture if picture.size == box else picture.resize(box, Image.Resampling.NEAREST)
        self._draw(np.asarray(resized, dtype=np.int16))
