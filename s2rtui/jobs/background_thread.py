"""Background threads that never block shutdown."""

from __future__ import annotations

import atexit
import os
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from threading import Condition, Event, Thread

from s2rstore.errors import one_line

Work = Callable[[], object]
ReportError = Callable[[Exception], object]

_EXIT_TIMEOUT = 30.0
_running: set[object] = set()
_any_started = Event()


class LatestOnlyWorker:
    """A thread that runs one piece of work at a time; newer work replaces waiting work."""

    def __init__(self, name: str, report_error: ReportError = traceback.print_exception) -> None:
        """The thread starts with the first work and calls `report_error` for work that raises.

        An idle worker holds no reference to the work it has done.
        """
        self._name, self._report_error = name, report_error
        self._changed = Condition()
        self._next: Work | None = None
        self._last: Work | None = None
        self._started = self._ended = self._busy = False

    @property
    def was_used(self) -> bool:
        """Whether any work was ever put."""
        return self._started

    @property
    def idle(self) -> bool:
        """Whether no work runs or waits."""
        with self._changed:
            return not self._busy and self._next is None

    def put(self, work: Work) -> None:
        """Run work after the present one, in place of waiting work."""
        with self._changed:
            if self._ended:
                return
            self._next = work
            if not self._started:
                self._started = True
                Thread(target=self._run, name=self._name, daemon=True).start()
            self._changed.notify()

    def end(self, last: Work | None = None) -> None:
        """Drop waiting work; after the present one the thread runs `last` and ends."""
        with self._changed:
            self._ended, self._next, self._last = True, None, last
            self._changed.notify()

    def _run(self) -> None:
        while (work := self._next_work()) is not None:
            self._try(work)
            del work  # a waiting worker must not keep the work's objects alive
        if self._last is not None:
            self._try(self._last)

    def _next_work(self) -> Work | None:
        """Wait for the next work; None at the end."""
        with self._changed:
            self._busy = False
            while self._next is None and not self._ended:
                self._changed.wait()
            work, self._next = self._next, None
            self._busy = work is not None
        return work

    def _try(self, work: Work) -> None:
        try:
            _run_tracked(work)
        except Exception as error:
            self._report_error(error)


def run_in_thread(name: str, work: Work) -> None:
    """Run one piece of work, which must not raise, in a new thread."""
    Thread(target=_run_tracked, args=(work,), name=name, daemon=True).start()


class BackgroundJobs:
    """One-off jobs in threads, each with a text about its missing result until it has ended."""

    def __init__(self, report_failure: Callable[[str], object]) -> None:
        """`report_failure` gets the text for a job that raised; it is called in its thread."""
        self._report_failure = report_failure
        self._unfinished: dict[object, str] = {}
        self._is_closed = False

    @property
    def unfinished(self) -> tuple[str, ...]:
        """The texts of the jobs that have not ended, or failed after `close`."""
        return tuple(self._unfinished.values())

    def start(self, work: Callable[[], None], missing: str) -> None:
        """Run a job; `missing` describes its missing result."""
        token = object()
        self._unfinished[token] = missing

        def run() -> None:
            try:
                work()
            except Exception as error:  # reported on the screen, whatever it is
                if self._is_closed:
                    return
                reason = one_line(error)
                self._report_failure(f"{missing} ({type(error).__name__}: {reason})")
            del self._unfinished[token]

        run_in_thread(missing, run)

    def close(self) -> None:
        """Report no more failures: a job that fails from now on stays unfinished."""
        self._is_closed = True


def _run_tracked(work: Work) -> None:
    token = object()
    _any_started.set()
    _running.add(token)
    try:
        work()
    finally:
        _running.discard(token)


def wait_until_idle(timeout: float) -> bool:
    """Wait at most `timeout` seconds for all work; whether it has ended."""
    limit = time.monotonic() + timeout
    while _running and time.monotonic() < limit:
        time.sleep(0.01)
    return not _running


# Gives work time to end in programs that do not call `end_process`.
atexit.register(wait_until_idle, _EXIT_TIMEOUT)


def end_process(code: int) -> int:
    """Return `code` if no thread was ever started; otherwise end the process with it here.

    An interpreter that shuts down around threads in native code can crash, and unloading large
    libraries takes seconds.
    """
    if not _any_started.is_set():
        return code
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or its reader is gone
            stream.flush()
    os._exit(code)
