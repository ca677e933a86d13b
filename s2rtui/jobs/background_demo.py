"""The rest of `s2r demo`, which another process computes while the application is open."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

LOG = "demo.log"
"""File in the folder of the demo with the output of the process."""
_NICE = 10
PAUSE = 0.5
"""Seconds between two looks at what is published."""


class BackgroundDemo:
    """A process that completes the demo; it goes on when this one ends, unless it is stopped."""

    def __init__(self, folder: Path, arguments: Sequence[str]) -> None:
        """Start `s2r demo --no-open` with some arguments."""
        self.log = folder / LOG
        self.log.touch()
        self._begin = self.log.stat().st_size
        command = [sys.executable, "-P", "-m", "s2rtui", "demo", "--no-open", *arguments]
        with self.log.open("ab") as output:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                start_new_session=True,
            )  # fmt: skip

    @property
    def is_running(self) -> bool:
        return self._process.poll() is None

    @property
    def has_failed(self) -> bool:
        return self._process.poll() not in (None, 0)

    @property
    def last_line(self) -> str:
        """The last line of its output: the error of a process that failed."""
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"s2r demo ended with code {self._process.returncode}"

    def wait_until(self, is_reached: Callable[[], bool]) -> bool:
        """Show its output until something is reached; False if it ends before.

        Then its priority is lowered.
        """
        with self.log.open("rb") as output:
            output.seek(self._begin)
            while not is_reached():
                sys.stderr.write(output.read().decode(errors="replace"))
                sys.stderr.flush()
                if not self.is_running:
                    return is_reached()
                time.sleep(PAUSE)
        with suppress(OSError):
            os.setpriority(os.PRIO_PGRP, self._process.pid, _NICE)
        return True

    def stop(self) -> None:
        """End the process and its workers; what they have computed stays."""
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGTERM)


def start_compiling() -> None:
    """Let another process compile what the projection needs, so that it is ready in time."""
    command = [sys.executable, "-P", "-m", "s2rtools.precompute.compile_ahead"]
    subprocess.Popen(
        ["nice", *command] if shutil.which("nice") else command, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
