"""The protocols by which terminals draw images, and the size of a cell in pixels."""

from __future__ import annotations

import fcntl
import struct
import sys
import termios
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

from s2rtui.canvas import Size

USUAL_CELL = (10, 20)
GraphicsProtocol = Literal["kitty", "iterm2", "sixel"]
NAMES = {"kitty": "Kitty graphics protocol", "iterm2": "iTerm2 protocol", "sixel": "sixels"}


@dataclass(frozen=True, slots=True)
class Graphics:
    """How the terminal draws images (None: it does not), why, and its cells in pixels.

    `cell`: (width, height), used where the system does not know the size, or always if
    `is_cell_fixed`.
    """

    protocol: GraphicsProtocol | None
    reason: str
    cell: Size = USUAL_CELL
    in_tmux: bool = False
    is_cell_fixed: bool = False

    @property
    def supported(self) -> bool:
        """Whether the terminal draws images."""
        return self.protocol is not None

    def cell_now(self) -> Size:
        """(width, height) of a cell in pixels, which change with the font."""
        return self.cell if self.is_cell_fixed else cell_pixels(self.cell)

    def with_cell(self, cell: Size | None) -> Graphics:
        """The same with a cell size that was given, None for the terminal's own."""
        return self if cell is None else replace(self, cell=cell, is_cell_fixed=True)


def cell_pixels(otherwise: Size = USUAL_CELL) -> Size:
    """(width, height) of a cell in pixels, or `otherwise` if the system does not know it."""
    with suppress(OSError, ValueError, AttributeError):
        size = fcntl.ioctl(sys.__stdout__.fileno(), termios.TIOCGWINSZ, bytes(8))  # type: ignore[union-attr]
        rows, columns, width, height = struct.unpack("HHHH", size)
        if rows and columns and width >= columns and height >= rows:
            return width // columns, height // rows
    return otherwise
