"""Work in threads of their own that nobody has to wait for, not even the end of the process."""

from __future__ import annotations

import atexit
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Condition, Thread

Work = Callable[[], object]

_LAST_PATIENCE = 30.0
_under_way: set[object] = set()


class Lane:
    """A thread that does one thing after another; of what waits only the newest is kept."""

    def __init__(self, name: str) -> None:
        """The thread starts with the first piece of work."""
        self._name = name
        self._changed = Condition()
        self._next: Work | None = None
        self._last: Work | None = None
        self._started = self._ended = False

    def put(self, work: Work) -> None:
        """Do this after what is under way, in place of what waits. It must not raise."""
        with self._changed:
            if self._ended:
                return
            self._next = work
            if not self._started:
                self._started = True
                Thread(target=self._run, name=self._name, daemon=True).start()
            self._changed.notify()

    def end(self, last: Work | None = None) -> None:
        """Drop what waits; after what is under way the thread does `last`, and ends."""
        with self._changed:
            self._ended, self._next, self._last = True, None, last
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._next is None and not self._ended:
                    self._changed.wait()
                work, self._next = self._next, None
                if work is None:
                    break
            _do(work)
        if self._last is not None:
            _do(self._last)


def start(name: str, work: Work) -> None:
    """Do one piece of work in a thread of its own. It must not raise."""
    Thread(target=_do, args=(work,), name=name, daemon=True).start()


def _do(work: Work) -> None:
    token = object()
    _under_way.add(token)
    try:
        work()
    finally:
        _under_way.discard(token)


def rest(patience: float) -> bool:
    """Whether nothing is under way, after `patience` seconds at most."""
    limit = time.monotonic() + patience
    while _under_way and time.monotonic() < limit:
        time.sleep(0.01)
    return not _under_way


def _rest_at_last() -> None:
    """For programs that do not end by `end_process`."""
    rest(_LAST_PATIENCE)


atexit.register(_rest_at_last)


def end_process(code: int) -> int:
    """`code` where nothing is under way; otherwise the process ends here, with that code.

    Threads inside of native code would bring down an interpreter that ends around them.
    """
    if rest(0.0):
        return code
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or its reader is gone
            stream.flush()
    os._exit(code)
