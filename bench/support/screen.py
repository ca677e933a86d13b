"""A terminal for tests: run a program on a pseudo-terminal and read the emulated screen."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import termios
import threading
import time
from collections.abc import Callable, Mapping, Sequence

import pyte

PATIENCE = 60.0
RIGHT, LEFT, CTRL_C, CTRL_P, CTRL_Z, ESCAPE = (
    b"\x1b[C", b"\x1b[D", b"\x03", b"\x10", b"\x1a", b"\x1b",
)  # fmt: skip
# Sequences with private markers, of which the emulator would print the end.
_PRIVATE = re.compile(rb"\x1b\[[<>=][0-9;]*[a-zA-Z]|\x1b\[\?[0-9;]*\$p")


def emulator(size: tuple[int, int]) -> tuple[pyte.Screen, pyte.ByteStream]:
    """An empty screen of columns and rows, and the stream that draws on it."""
    screen = pyte.Screen(*size)
    return screen, pyte.ByteStream(screen)


def feed(stream: pyte.ByteStream, data: bytes) -> bytes:
    """Draw what is complete; gives back a sequence that is cut in two, for the next call."""
    cut = data.rfind(b"\x1b")
    whole = cut < 0 or re.match(rb"\x1b(\[[0-9;<>=?$]*[a-zA-Z]|[^\[])", data[cut:])
    data, rest = (data, b"") if whole else (data[:cut], data[cut:])
    stream.feed(_PRIVATE.sub(b"", data))
    return rest


def start_on_terminal(
    command: Sequence[str], size: tuple[int, int], environment: Mapping[str, str]
) -> tuple[subprocess.Popen[bytes], int]:
    """A process with a controlling terminal of its own, and the descriptor that reads it.

    `pty.fork` would run Python between fork and exec, which can deadlock in a process with threads.
    """
    primary, secondary = os.openpty()
    termios.tcsetwinsize(primary, size[::-1])
    process = subprocess.Popen(
        ["setsid", "--ctty", *command],
        stdin=secondary, stdout=secondary, stderr=secondary, env=environment,
    )  # fmt: skip
    os.close(secondary)
    return process, primary


class Screen:
    """Runs `command` on a terminal of `size` columns and rows; a thread reads and draws.

    `raw` holds all bytes that arrived, `arrivals` the time and size of each piece.
    """

    def __init__(
        self,
        command: Sequence[str],
        size: tuple[int, int] = (80, 24),
        environment: Mapping[str, str] | None = None,
        draws: bool = True,
    ) -> None:
        """Without `draws` the bytes are only kept."""
        self._draws = draws
        self._emulator, self._stream = emulator(size)
        self._changed = threading.Condition()
        self._rest = b""
        self.raw = bytearray()
        self.arrivals: list[tuple[float, int]] = []
        self.code: int | None = None
        env = {"TERM": "xterm-256color", "LANG": "C.UTF-8", **(environment or {})}
        env |= {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
        self._process, self._fd = start_on_terminal(command, size, env)
        self.pid = self._process.pid
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while True:
            try:
                piece = os.read(self._fd, 1 << 16)
            except OSError:
                piece = b""
            with self._changed:
                if not piece:
                    self.code = self._process.wait()
                    self._changed.notify_all()
                    return
                self.raw += piece
                self.arrivals.append((time.monotonic(), len(piece)))
                if self._draws:
                    self._rest = feed(self._stream, self._rest + piece)
                self._changed.notify_all()

    @property
    def lines(self) -> list[str]:
        with self._changed:
            return [line.rstrip() for line in self._emulator.display]

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def press(self, keys: str | bytes) -> None:
        os.write(self._fd, keys.encode() if isinstance(keys, str) else keys)

    def resize(self, columns: int, rows: int) -> None:
        with self._changed:
            self._emulator.resize(rows, columns)
        self.resize_terminal(columns, rows)

    def resize_terminal(self, columns: int, rows: int) -> None:
        """Set the size for the program only, for sizes that the emulator cannot hold."""
        termios.tcsetwinsize(self._fd, (rows, columns))
        os.kill(self.pid, signal.SIGWINCH)

    def wait_for(self, wanted: str | Callable[[str], bool], patience: float = PATIENCE) -> str:
        """The screen's text once it holds `wanted`; AssertionError shows what it held instead."""
        holds = wanted if callable(wanted) else lambda text: wanted in text
        limit = time.monotonic() + patience
        with self._changed:
            while True:
                text = "\n".join(line.rstrip() for line in self._emulator.display)
                if holds(text):
                    return text
                left = limit - time.monotonic()
                if left <= 0 or self.code is not None:
                    outcome = (
                        "timed out waiting" if self.code is None else f"ended with {self.code}"
                    )
                    raise AssertionError(f"{outcome} for {wanted!r}; the screen:\n{text}")
                self._changed.wait(left)

    @property
    def received(self) -> int:
        """Bytes that arrived so far."""
        return len(self.raw)

    def wait_for_bytes(self, received: int, patience: float) -> bool:
        """Whether more than `received` bytes arrive in time: some keys change nothing."""
        with self._changed:
            return self._changed.wait_for(lambda: self.received > received, patience)

    def wait_for_end(self, patience: float = PATIENCE) -> int:
        """The program's exit code; AssertionError with the screen where it does not end."""
        limit = time.monotonic() + patience
        with self._changed:
            while self.code is None:
                left = limit - time.monotonic()
                if left <= 0:
                    raise AssertionError("still running; the screen:\n" + "\n".join(self.lines))
                self._changed.wait(left)
            return self.code

    def kill(self) -> None:
        """As when the network goes away: the client dies without a word."""
        if self.code is None:
            os.kill(self.pid, signal.SIGKILL)
            self._thread.join(10)

    def close(self) -> None:
        if self.code is None:
            os.kill(self.pid, signal.SIGHUP)
            self._thread.join(10)
        os.close(self._fd)
