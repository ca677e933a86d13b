"""A command of s2r that a subprocess executes while the application is open.

It ends with the application, also when that is killed, and has a low priority.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import IO, Literal

from s2rstore.security import working_folder

_NICE = 10

Outcome = Literal["running", "done", "failed", "cancelled"]


@dataclass(frozen=True, slots=True)
class JobProgress:
    """Progress of a job: fraction 0 .. 1, None where unknown, and stage.

    `error` is one line if it failed.
    """

    fraction: float | None
    stage: str
    outcome: Outcome = "running"
    error: str = ""

    @property
    def is_running(self) -> bool:
        return self.outcome == "running"

    @property
    def text(self) -> str:
        return self.stage if self.fraction is None else f"{self.fraction:.0%}, {self.stage}"


class CommandJob:
    """An execution of `s2r ... --progress json`. Safe to use from any thread."""

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        stages: int | None = None,
        successes: Sequence[int] = (0,),
        undo: Callable[[], object] | None = None,
    ) -> None:
        """Start `s2r` with some arguments, a command that reports `stages` stages of progress.

        `successes` are the exit codes of a command that has done its work. `undo` is called when it
        fails by itself; what it raises is told with the error. On Linux the subprocess ends with
        the thread that starts it: that thread must `follow`.
        """
        self.name = name
        self._stages, self._stages_begun = stages, 0
        self._successes, self._undo = successes, undo
        self._progress = JobProgress(0.0 if stages else None, "starting")
        self._changed = threading.Condition()
        self._is_cancelled = False
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        working_folder.drop_empty_entries(os.environ)
        command = [sys.executable, "-P", "-m", "s2rtui", *arguments, "--progress", "json"]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self._errors,
            start_new_session=True,
        )  # fmt: skip
        with contextlib.suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICE)
        threading.Thread(target=self._listen, name=name, daemon=True).start()

    @property
    def progress(self) -> JobProgress:
        """The present progress."""
        with self._changed:
            return self._progress

    def follow(self) -> Iterator[JobProgress]:
        """Yield every change until the outcome; blocks in between."""
        last: JobProgress | None = None
        while last is None or last.is_running:
            with self._changed:
                while last == self._progress:
                    self._changed.wait()
                last = self._progress
            yield last

    def cancel(self) -> None:
        """End the subprocess and its workers; what it has published stays."""
        self._is_cancelled = True
        with contextlib.suppress(OSError):  # has ended already
            os.killpg(self._process.pid, signal.SIGTERM)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._read_progress(line)
        code = self._process.wait()
        with self._errors:
            self._publish(self._outcome(code))

    def _outcome(self, code: int) -> JobProgress:
        if code in self._successes:
            return JobProgress(1.0, "done", "done")
        failed = replace(self.progress, outcome="failed", error=self._last_error(code))
        if self._is_cancelled:
            return replace(failed, outcome="cancelled", error="")
        try:
            if self._undo is not None:
                self._undo()
        except Exception as error:  # the outcome must always be reported
            return replace(failed, error=f"{failed.error}; {error}")
        return failed

    def _last_error(self, code: int) -> str:
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("s2r: ") if lines else f"s2r ended with code {code}"

    def _read_progress(self, line: bytes) -> None:
        try:
            event = json.loads(line)
            stage, done, total = str(event["stage"]), int(event["done"]), int(event["total"])
        except (ValueError, KeyError, TypeError):
            return
        self._stages_begun += done == 0
        fraction = None
        if self._stages is not None:
            share = (max(self._stages_begun, 1) - 1 + done / max(total, 1)) / self._stages
            fraction = min(share, 0.99)
        shown = stage.rpartition(": ")[2]  # without the run
        self._publish(JobProgress(fraction, f"{shown} {done}/{total}"))

    def _publish(self, progress: JobProgress) -> None:
        with self._changed:
            self._progress = progress
            self._changed.notify_all()
