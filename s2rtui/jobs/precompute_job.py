"""Save adjustments as a run: register it and compute it in a subprocess.

The subprocess is `s2r precompute`, so the run equals one made on the command line, and a later
precompute continues it. It ends with the application, also when that is killed.
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
from s2rstore.errors import StoreBusyError
from s2rstore.files import locks
from s2rstore.geometry.camera_offset import UNCHANGED
from s2rstore.records import SIDES, Side
from s2rstore.run_inputs import run_render_change
from s2rstore.security import working_folder

_NICE = 10
_STAGES = 3
"""Stages that precompute reports for a run; one more if cameras are moved."""

Chains = Mapping[Side, Sequence[dict[str, Any]]]
Outcome = Literal["running", "done", "failed", "cancelled"]


@dataclass(frozen=True, slots=True)
class JobProgress:
    """Progress of a job: fraction 0 .. 1 and stage; `error` is one line if it failed."""

    fraction: float
    stage: str
    outcome: Outcome = "running"
    error: str = ""

    @property
    def is_running(self) -> bool:
        return self.outcome == "running"


def save_run(root: Path, name: str, from_run: str, chains: Chains) -> PrecomputeJob:
    """Register a run with the model and domains of `from_run` and start computing it.

    A side that `chains` does not name keeps the adjustments of `from_run`. Raises RequestError for
    a name in use, an unknown run, a store that is read-only or being computed in, and cameras that
    cannot be moved; ModuleNotFoundError if the tools are not installed.
    """
    from s2rtools.precompute.run_registration import add_run, drop_run

    with locks.compute_lock(root):
        pass  # raises before anything is registered
    with s2rstore.open(root) as store:
        run = store.run(from_run)
        model = run.network("a run with adjusted images")
        sim, real = ([*chains.get(side, run.adjustments(side))] for side in SIDES)
        add_run(root, name, model, run.sim_domain, run.real_domain, {"sim": sim, "real": real})
        adjusted = replace(run, sim_adjustments=sim, real_adjustments=real)
        moves_camera = any(run_render_change(store, adjusted, side) != UNCHANGED for side in SIDES)
    try:
        return PrecomputeJob(root, name, _STAGES + moves_camera)
    except OSError:
        with contextlib.suppress(StoreBusyError):
            drop_run(root, name)
        raise


class PrecomputeJob:
    """The computation of one run. Safe to use from any thread."""

    def __init__(self, root: Path, run: str, stages: int) -> None:
        """Start the subprocess, which will report `stages` stages.

        On Linux the subprocess ends with the thread that starts it: that thread must `follow`.
        """
        self.root, self.run = root, run
        self._stages, self._stages_begun = stages, 0
        self._progress = JobProgress(0.0, "starting")
        self._changed = threading.Condition()
        self._is_cancelled = False
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115
        working_folder.drop_empty_entries(os.environ)
        command = [sys.executable, "-P", "-m", "s2rtui", "precompute", str(root.absolute()),
                   "--run", run, "--progress", "json"]  # fmt: skip
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self._errors,
            start_new_session=True,
        )  # fmt: skip
        with contextlib.suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICE)
        threading.Thread(target=self._listen, name=f"saving {run}", daemon=True).start()

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
        """End the subprocess and its workers.

        The run stays registered: `s2r precompute` continues it.
        """
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
        """The final progress; a failed run is removed from the store, so that its name is free.

        It stays where another process computes, which may compute this run.
        """
        if code == 0:
            return JobProgress(1.0, "done", "done")
        failed = replace(self.progress, outcome="failed", error=self._last_error(code))
        if self._is_cancelled:
            return replace(failed, outcome="cancelled", error="")
        try:
            from s2rtools.precompute.run_registration import drop_run

            drop_run(self.root, self.run)
        except StoreBusyError:
            kept = f"run {self.run} stays, because another process computes in this store"
            return replace(failed, error=f"{failed.error}; {kept}")
        except Exception as error:  # the outcome must always be reported
            return replace(failed, error=f"{failed.error}; {error}")
        return failed

    def _last_error(self, code: int) -> str:
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("s2r: ") if lines else f"precompute ended with code {code}"

    def _read_progress(self, line: bytes) -> None:
        try:
            event = json.loads(line)
            stage, done, total = str(event["stage"]), int(event["done"]), int(event["total"])
        except (ValueError, KeyError, TypeError):
            return
        self._stages_begun += done == 0
        share = (max(self._stages_begun, 1) - 1 + done / max(total, 1)) / self._stages
        stage = stage.removeprefix(f"{self.run}: ")
        self._publish(JobProgress(min(share, 0.99), f"{stage} {done}/{total}"))

    def _publish(self, progress: JobProgress) -> None:
        with self._changed:
            self._progress = progress
            self._changed.notify_all()
