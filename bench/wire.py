"""Bytes that a key press costs on a real pseudo-terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

from bench.figures import Figure

_QUIET = 0.6


class Terminal:
    """The application on a pty of 120 x 40."""

    def __init__(self, store: Path) -> None:
        pid, self._fd = pty.fork()
        if pid == 0:
            os.environ.update(TERM="xterm-256color", COLORTERM="truecolor", LANG="C.UTF-8")
            os.execv(sys.executable, [sys.executable, "-m", "s2rtui", "tui", str(store)])
        fcntl.ioctl(self._fd, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
        self._pid = pid

    def read(self, quiet: float = _QUIET, patience: float = 20.0) -> list[tuple[float, int]]:
        """(time, bytes) of what arrives until nothing did for `quiet` seconds."""
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
        os.waitpid(self._pid, 0)


def figures(store: Path) -> Iterator[Figure]:
    """The move itself, and the pictures once the cursor rests."""
    terminal = Terminal(store)
    terminal.read(2.0)
    moves, pictures = [], []
    for _ in range(6):
        began = time.monotonic()
        terminal.press(b"\x1b[C")
        arrived = terminal.read()
        moves.append(sum(size for at, size in arrived if at - began < 0.14))
        pictures.append(sum(size for at, size in arrived if at - began >= 0.14))
    terminal.press(b" ")
    terminal.read(1.0)
    idle = sum(size for _, size in terminal.read(6.0, 7.0))
    terminal.close()
    yield Figure("cursor to the next instance, the move", max(moves), "bytes", 4000)
    yield Figure("cursor to the next instance, its pictures", max(pictures), "bytes", 24_000)
    yield Figure("six seconds without a key", idle, "bytes", 0)
