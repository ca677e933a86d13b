"""Work in threads of their own that nobody has to wait for, not even the end of the process."""

from __future__ import annotations

import atexit
import os
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from threading import Condition, Event, Thread

Work = Callable[[], object]
Tell = Callable[[Exception], object]

_LAST_PATIENCE = 30.0
_under_way: set[object] = set()
_used = Event()


class Lane:
    """A thread that does one thing after another; of what waits only the newest is kept."""

    def __init__(self, name: str, tell: Tell = traceback.print_exception) -> None:
        """The thread starts with the first piece of work; `tell` hears, in it, of one that raises.

        A lane at rest holds nothing of what it has done.
        """
        self._name, self._tell = name, tell
        self._changed = Condition()
        self._next: Work | None = None
        self._last: Work | None = None
        self._started = self._ended = self._busy = False

    @property
    def begun(self) -> bool:
        """Whether anything was ever put."""
        return self._started

    @property
    def idle(self) -> bool:
        """Whether nothing is under way or waits."""
        with self._changed:
            return not self._busy and self._next is None

    def put(self, work: Work) -> None:
        """Do this after what is under way, in place of what waits."""
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
        while (work := self._taken()) is not None:
            self._try(work)
            del work  # held while the lane waits, it would keep all that it was made with
        if self._last is not None:
            self._try(self._last)

    def _taken(self) -> Work | None:
        """The next work once there is one; None at the end."""
        with self._changed:
            self._busy = False
            while self._next is None and not self._ended:
                self._changed.wait()
            work, self._next = self._next, None
            self._busy = work is not None
        return work

    def _try(self, work: Work) -> None:
        """The lane outlives what its work raises."""
        try:
            _do(work)
        except Exception as error:
            self._tell(error)


def start(name: str, work: Work) -> None:
    """Do one piece of work in a thread of its own. It must not raise."""
    Thread(target=_do, args=(work,), name=name, daemon=True).start()


def _do(work: Work) -> None:
    token = object()
    _used.set()
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
    """`code` where no thread was ever started; otherwise the process ends here, with that code.

    Threads inside of native code would bring down an interpreter that ends around them, and to take
    down large libraries in good order takes seconds.
    """
    if not _used.is_set():
        return code
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or its reader is gone
            stream.flush()
    os._exit(code)
