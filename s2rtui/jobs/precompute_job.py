"""Saving adjustments as a run: registered here, computed by a process of its own in the background.

The process is `s2r precompute`, so the run is the one that the command line makes, and what it has
finished is taken up by the next one. It ends with the application, also where that is killed.
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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Literal

import s2rstore
from s2rstore.files import locks
from s2rstore.geometry.camera_offset import UNMOVED
from s2rstore.records import SIDES, Side
from s2rstore.run_inputs import run_camera_move
from s2rstore.security import working_folder

_NICE = 10
_GROUPS = 3
"""Stages that precompute announces for a run, one more where cameras are moved."""

Chains = Mapping[Side, Sequence[dict[str, Any]]]
Outcome = Literal["running", "done", "failed", "left"]


@dataclass(frozen=True, slots=True)
class JobProgress:
    """How far a saving is: a fraction 0 .. 1 and the stage; `error` is one line where it failed."""

    fraction: float
    stage: str
    outcome: Outcome = "running"
    error: str = ""

    @property
    def is_running(self) -> bool:
        return self.outcome == "running"


def save_run(
    root: Path, name: str, from_run: str, chains: Chains, trust: bool = False
) -> PrecomputeJob:
    """Register a run with the model and domains of another and start computing it.

    A side that `chains` does not name keeps the other run's adjustments. Raises RequestError for
    a name that is taken, unknown runs, a read-only store, one that a process is computing in, and
    cameras that cannot be moved; and ModuleNotFoundError without the tools.
    """
    from s2rtools.precompute.registration import add_run, drop_run

    with locks.compute_lock(root):
        pass  # refused before anything is registered
    with s2rstore.open(root) as store:
        run = store.run(from_run)
        sim, real = ([*chains.get(side, run.adjustments(side))] for side in SIDES)
        add_run(root, name, run.model, run.sim_domain, run.real_domain, {"sim": sim, "real": real})
        made = replace(run, sim_adjustments=sim, real_adjustments=real)
        moves = any(run_camera_move(store, made, side) != UNMOVED for side in SIDES)
    try:
        return PrecomputeJob(root, name, _GROUPS + moves, trust)
    except OSError:
        drop_run(root, name)
        raise


class PrecomputeJob:
    """A run on its way into the store. Safe to use from any thread."""

    def __init__(self, root: Path, run: str, groups: int, trust: bool) -> None:
        """Starts the process; `groups` is the number of stages that it will announce.

        However this thread ends, the process ends with it (Linux): let it `follow`.
        """
        self.root, self.run = root, run
        self._groups, self._begun = groups, 0
        self._progress = JobProgress(0.0, "starting")
        self._changed = threading.Condition()
        self._left = False
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        working_folder.drop_empty_entries(os.environ)
        command = [sys.executable, "-P", "-m", "s2rtui", "precompute", str(root.absolute()),
                   "--run", run, "--progress", "json"]  # fmt: skip
        self._process = subprocess.Popen(
            command + (["--trust"] if trust else []), stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=self._errors, start_new_session=True,
        )  # fmt: skip
        with contextlib.suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICE)
        threading.Thread(target=self._listen, name=f"saving {run}", daemon=True).start()

    @property
    def progress(self) -> JobProgress:
        """How far it is now."""
        with self._changed:
            return self._progress

    def follow(self) -> Iterator[JobProgress]:
        """Every change as it comes, the last one with the outcome; blocks in between."""
        shown: JobProgress | None = None
        while shown is None or shown.is_running:
            with self._changed:
                while shown == self._progress:
                    self._changed.wait()
                shown = self._progress
            yield shown

    def leave(self) -> None:
        """End the process and its workers; a unit that is cut short is no harm.

        The run stays registered, for `s2r precompute` to go on with.
        """
        self._left = True
        with contextlib.suppress(OSError):  # it has ended already
            os.killpg(self._process.pid, signal.SIGTERM)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._heard(line)
        code = self._process.wait()
        with self._errors:
            self._set(self._ended(code))

    def _ended(self, code: int) -> JobProgress:
        """The outcome; what has failed leaves the store, so that its name is free."""
        if code == 0:
            return JobProgress(1.0, "done", "done")
        failed = replace(self.progress, outcome="failed", error=self._last_error(code))
        if self._left:
            return replace(failed, outcome="left", error="")
        try:
            from s2rtools.precompute.registration import drop_run

            drop_run(self.root, self.run)
        except Exception as error:  # whatever it was, somebody waits for the outcome
            return replace(failed, error=f"{failed.error}; {error}")
        return failed

    def _last_error(self, code: int) -> str:
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("s2r: ") if lines else f"precompute ended with code {code}"

    def _heard(self, line: bytes) -> None:
        try:
            told = json.loads(line)
            stage, done, total = str(told["stage"]), int(told["done"]), int(told["total"])
        except (ValueError, KeyError, TypeError):
            return
        self._begun += done == 0
        share = (max(self._begun, 1) - 1 + done / max(total, 1)) / self._groups
        stage = stage.removeprefix(f"{self.run}: ")
        self._set(JobProgress(min(share, 0.99), f"{stage} {done}/{total}"))

    def _set(self, progress: JobProgress) -> None:
        with self._changed:
            self._progress = progress
            self._changed.notify_all()
