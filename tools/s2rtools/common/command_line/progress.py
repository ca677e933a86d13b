"""Progress of long operations: a bar on a terminal, occasional lines in a log, or JSON."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal, Protocol

from s2rstore.security.printable_text import printable, underlying_stream
from s2rtools.common.parent_process import end_with_parent

Style = Literal["auto", "json"]
STYLES: tuple[Style, ...] = ("auto", "json")
_LOG_SECONDS = 10.0


class Reporter(Protocol):
    """Receiver of progress: `begin` a stage of `total` steps, `advance` it, `say` a line."""

    def begin(self, stage: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...


class LogReporter:
    """Writes a line to standard error every ten seconds and at the end of a stage."""

    _stage, _total, _done = "", 0, 0
    _started = _last_line = 0.0

    def begin(self, stage: str, total: int) -> None:
        self._stage, self._total, self._done = stage, total, 0
        self._started = self._last_line = time.monotonic()

    def advance(self, steps: int) -> None:
        self._done += steps
        now = time.monotonic()
        finished = self._done >= self._total
        if finished or now - self._last_line >= _LOG_SECONDS:
            self._last_line = now
            self.say(f"{self._stage}: {self._done}/{self._total}, {now - self._started:.0f} s")

    def say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)


class JsonReporter:
    """Writes one JSON object per line to standard output: {"stage", "done", "total"} or {"said"}.

    A closed pipe is ignored, so that the operation continues.
    """

    _stage, _total, _done = "", 0, 0

    def begin(self, stage: str, total: int) -> None:
        self._stage, self._total, self._done = stage, total, 0
        self.advance(0)

    def advance(self, steps: int) -> None:
        self._done += steps
        self._write({"stage": self._stage, "done": self._done, "total": self._total})

    def say(self, line: str) -> None:
        self._write({"said": line})

    def _write(self, message: dict[str, object]) -> None:
        try:
            print(json.dumps(message), flush=True)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class BarReporter:
    """A rich progress bar per stage."""

    def __init__(self, progress: Any) -> None:
        self._progress = progress
        self._task: Any = None

    def begin(self, stage: str, total: int) -> None:
        self._task = self._progress.add_task(printable(stage), total=total)

    def advance(self, steps: int) -> None:
        if self._task is not None:
            self._progress.advance(self._task, steps)

    def say(self, line: str) -> None:
        self._progress.console.print(printable(line), highlight=False, markup=False)


def percent_callback(reporter: Reporter, stage: str) -> Callable[[float, float, float], None]:
    """Return a callback (fraction done, last loss, remaining seconds) of a stage of 100 steps."""
    reporter.begin(stage, 100)
    done = 0

    def report(fraction: float, loss: float, seconds: float) -> None:
        nonlocal done
        steps = int(100 * fraction) - done
        if steps > 0:
            done += steps
            reporter.advance(steps)

    return report


def add_progress(parser: argparse._ActionsContainer) -> None:
    """Add option --progress."""
    parser.add_argument("--progress", choices=STYLES, default="auto",
                        help="json prints one object per line on standard output and ends "
                        "together with the parent process")  # fmt: skip


@contextmanager
def reporter(style: Style = "auto") -> Iterator[Reporter]:
    """Yield a bar or a log on standard error, depending on whether it is a terminal, or JSON.

    JSON is for a parent process, whose end is the end of this one.
    """
    if style == "json":
        end_with_parent()
        yield JsonReporter()
        return
    if not sys.stderr.isatty():
        yield LogReporter()
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(),
               TimeRemainingColumn())  # fmt: skip
    with Progress(*columns, console=Console(file=underlying_stream(sys.stderr))) as progress:
        yield BarReporter(progress)
