"""The end of a process together with its parent process."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from contextlib import suppress

_PR_SET_PDEATHSIG = 1


def end_with_parent(number: int = signal.SIGTERM, parent: int | None = None) -> None:
    """Send `number` to this process when its parent process ends for any reason.

    `parent` is the process id of the expected parent (default: the current parent); if that has
    ended already, this process ends at once. Linux does this in the kernel; on other systems a
    thread checks every half second.
    """
    parent = os.getppid() if parent is None else parent
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)
    else:
        threading.Thread(target=_poll_parent, args=(parent, number), daemon=True).start()
    if os.getppid() != parent:
        os._exit(1)


def _poll_parent(parent: int, number: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os.kill(os.getpid(), number)
