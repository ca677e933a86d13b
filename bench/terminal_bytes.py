"""Bytes that the first screen and every key press cost on a real pseudo-terminal."""

from __future__ import annotations

import math
import os
import select
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from bench.budget import BudgetRow
from bench.support.screen import start_on_terminal

_QUIET = 0.6
SIZES = ((120, 40), (200, 60))
_MOVE = b"\x1b[C"
_DRAWS_PICTURES = b"\x1b[1;1R\x1b_Gi=31;OK\x1b\\\x1b[1;1R\x1b[6;20;10t\x1b[?62c"
_TRUE_PIXELS = 320_000
"""Bytes of the map and four images at their size on a terminal of 120 x 40."""
KEYS = {
    "w": b"w", "b": b"b", "undo": b"u", "zoom in": b"+", "zoom out": b"0", "run": b"r",
    "umap": b"4", "orientation": b"5", "list": b"8", "map": b"2", "help": b"?", "leave": b"\x1b",
}  # fmt: skip
"""Keys in order; each acts on the state that the previous one left."""


class MeasuredTerminal:
    """The application on a pty of (columns, rows)."""

    def __init__(self, store: Path, size: tuple[int, int], *options: str) -> None:
        command = [sys.executable, "-m", "s2rtui", "tui", str(store), *options]
        variables = {"TERM": "xterm-256color", "COLORTERM": "truecolor", "LANG": "C.UTF-8"}
        self._process, self._fd = start_on_terminal(command, size, os.environ | variables)

    def read(self, quiet: float = _QUIET, patience: float = 20.0) -> list[tuple[float, int]]:
        """(time, bytes) of the output until there is none for `quiet` seconds."""
        found: list[tuple[float, int]] = []
        limit = time.monotonic() + patience
        while time.monotonic() < limit:
            ready, _, _ = select.select([self._fd], [], [], quiet)
            if not ready:
                return found
            try:
                found.append((time.monotonic(), len(os.read(self._fd, 1 << 20))))
            except OSError:  # the other end is closed
                return found
        return found

    def press(self, keys: bytes) -> None:
        os.write(self._fd, keys)

    def close(self) -> None:
        self.press(b"q")
        self.read(0.3, 3)
        os.close(self._fd)
        self._process.wait()


def figures(store: Path) -> Iterator[BudgetRow]:
    """Measure both sizes; only the smaller one has budgets."""
    for size in SIZES:
        terminal = MeasuredTerminal(store, size)
        at = f"{size[0]}x{size[1]}: "
        yield BudgetRow(f"{at}first screen", _sum(terminal.read(2.0)), "bytes")
        yield from _cursor(terminal, at, 24_000 if size == SIZES[0] else None)
        for name, key in KEYS.items():
            terminal.press(key)
            yield BudgetRow(f"{at}{name}", _sum(terminal.read()), "bytes")
        idle = _sum(terminal.read(6.0, 7.0))
        yield BudgetRow(f"{at}six seconds without a key", idle, "bytes", 0)
        terminal.close()
    yield from _true_pixels(store, SIZES[0])


def _true_pixels(store: Path, size: tuple[int, int]) -> Iterator[BudgetRow]:
    """Move the cursor on a terminal that draws images, with cells of 10 x 20 pixels."""
    terminal = MeasuredTerminal(store, size, "--graphics", "kitty")
    terminal.read(1.0, 5)
    terminal.press(_DRAWS_PICTURES)
    terminal.read(2.0)
    at = f"{size[0]}x{size[1]}, true pixels: "
    yield from _cursor(terminal, at, _TRUE_PIXELS)
    terminal.close()


def _cursor(terminal: MeasuredTerminal, at: str, bound: int | None) -> Iterator[BudgetRow]:
    """Largest of several: the bytes of a move, and of the images when the cursor rests."""
    moves, images = [], []
    for _ in range(6):
        began = time.monotonic()
        terminal.press(_MOVE)
        arrived = terminal.read()
        moves.append(_sum(arrived, until=began + 0.14))
        images.append(_sum(arrived) - moves[-1])
    name = f"{at}cursor to the next instance"
    yield BudgetRow(f"{name}, the move", max(moves), "bytes", 4000 if bound else None)
    yield BudgetRow(f"{name}, its pictures", max(images), "bytes", bound)


def _sum(arrived: list[tuple[float, int]], until: float = math.inf) -> int:
    return sum(size for at, size in arrived if at < until)
