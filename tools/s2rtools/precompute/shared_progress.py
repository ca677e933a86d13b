"""Progress of precompute that applications on the same store show, beside that of its caller."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Self

from s2rstore.files import compute_progress
from s2rtools.common.command_line.progress import Reporter
from s2rtools.precompute.run_stages import ROUNDS, WORK
from s2rtools.precompute.tasks import rendered_frames

_SECONDS = 1.0
"""Seconds between two writings."""


class SharedProgress:
    """A reporter that passes everything on, and writes it into the store.

    The time left is estimated from the speed since the start. It assumes that nothing of later
    rounds is computed yet.
    """

    def __init__(self, root: Path, reporter: Reporter) -> None:
        self._root, self._reporter = root, reporter
        self._stage, self._total, self._done = "", 0, 0
        self._begun = self._written = time.monotonic()
        self._work_done = self._work = self._work_ahead = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        compute_progress.remove(self._root)

    def expect(self, round_number: int, instances: int, runs_ahead: int, runs: int) -> None:
        """The next stages belong to a round of a run; `runs_ahead` others follow in this round."""
        present, *later = [WORK[name] for name in ROUNDS[round_number:]]
        self._work = present * instances
        self._work_ahead = instances * (present * runs_ahead + sum(later) * runs)

    def begin(self, stage: str, total: int) -> None:
        self._stage, self._total, self._done = stage, total, 0
        self._write()
        self._reporter.begin(stage, total)

    def advance(self, steps: int) -> None:
        self._reporter.advance(steps)
        self._done += steps
        if not self._stage.endswith(f": {rendered_frames.NAME}"):  # before the work of a round
            self._work_done += self._work * steps / max(self._total, 1)
            if self._done >= self._total:
                self._work = 0.0  # further stages of the round are short
        if time.monotonic() - self._written >= _SECONDS:
            self._write()

    def say(self, line: str) -> None:
        self._reporter.say(line)

    def _write(self) -> None:
        self._written = time.monotonic()
        share = 1 - self._done / self._total if self._total else 0.0
        left = None
        if self._work_done:
            speed = self._work_done / (self._written - self._begun)
            left = (self._work_ahead + self._work * share) / speed
        compute_progress.write(self._root, self._stage, self._done, self._total, left)
