"""End the application on SIGTERM and SIGHUP, also while its event loop is blocked."""

from __future__ import annotations

import asyncio
import os
import select
import signal
import termios
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGTERM, signal.SIGHUP)
FORCE_AFTER_SECONDS = 1.5
"""Time after which a shutdown that does not finish is forced."""
# Keyboard protocol, alternate screen, cursor, mouse, paste, focus, resize reports, line wrap.
_RESET = (
    b"\x1b[<u\x1b[?1049l\x1b[?25h\x1b[?1000l\x1b[?1003l\x1b[?1006l\x1b[?1015l\x1b[?1016l"
    b"\x1b[?2004l\x1b[?1004l\x1b[?2048l\x1b[?7h"
)


def end_on_signals(leave: Callable[[], object]) -> None:
    """Call `leave` in the running loop on SIGTERM and SIGHUP; end the process if it does not react.

    Call it in the main thread. To have the terminal restored, call `terminal_mode.remember` first.
    """
    loop = asyncio.get_running_loop()

    def on_signal(number: int, frame: FrameType | None) -> None:
        threading.Thread(target=_force_exit, args=(number,), name="ending", daemon=True).start()
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(leave)

    with suppress(ValueError):  # not the main thread
        for number in SIGNALS:
            signal.signal(number, on_signal)


class TerminalMode:
    """Saves the terminal mode at the start and restores it at the end."""

    def __init__(self) -> None:
        self._attributes: list[Any] | None = None

    def remember(self) -> None:
        with suppress(termios.error, OSError, ValueError):
            self._attributes = termios.tcgetattr(0)

    def restore(self) -> None:
        """Restore the terminal, without waiting for one that takes no output."""
        if self._attributes is None:
            return
        with suppress(termios.error, OSError, ValueError):
            termios.tcsetattr(0, termios.TCSANOW, self._attributes)
            if select.select([], [2], [], 0)[1]:
                os.write(2, _RESET)


terminal_mode = TerminalMode()


def _force_exit(number: int) -> None:
    time.sleep(FORCE_AFTER_SECONDS)
    terminal_mode.restore()
    os._exit(128 + number)
