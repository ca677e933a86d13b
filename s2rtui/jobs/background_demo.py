"""Child processes of `s2r demo`: its later stages, one parallel stage, and compilation."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

LOG = "demo.log"
"""File in the folder of the demo with the output of the process."""
_NICE = 10
PAUSE = 0.5
"""Seconds between two looks at what is published."""
_CHILD = """import sys
from s2rtools.common.parent_process import end_with_parent
end_with_parent(parent=int(sys.argv.pop(1)))
from s2rtui.cli import main
sys.exit(main())
"""


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


class ChildCommand:
    """A command of `s2r` in a child process, which is terminated when this process ends.

    Its output is printed by `wait`.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self._name = f"s2r {arguments[0]}"
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `stop`)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CHILD, str(os.getpid()), *arguments],
            stdin=subprocess.DEVNULL, stdout=self._output, stderr=self._output,
        )  # fmt: skip

    def wait(self) -> int:
        """Wait for the process, print its output on standard error and return its exit code."""
        code = self._process.wait()
        self._output.seek(0)
        sys.stderr.write(self._output.read().decode(errors="replace"))
        if code < 0:
            name = signal.Signals(-code).name
            print(f"s2r: {self._name} was ended by signal {name}", file=sys.stderr)
            return os.EX_SOFTWARE
        return code

    def stop(self) -> None:
        """Terminate the process if it still runs, and discard its output."""
        self._process.terminate()
        self._process.wait()
        self._output.close()


def start_compiling() -> None:
    """Let another process compile what projections and the comparison of light need."""
    command = [sys.executable, "-P", "-m", "s2rtools.precompute.compile_ahead"]
    subprocess.Popen(
        ["nice", *command] if shutil.which("nice") else command, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
