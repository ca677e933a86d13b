"""Commands of s2r that compute what the store lacks, one at a time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rtui.jobs.command_job import CommandJob, JobProgress

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

_SHOWN_SECONDS = 5.0
"""Seconds for which a refusal hides the progress of the command that causes it."""


class ComputationController:
    """Starts one command at a time, and shows its progress and outcome."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._name: str | None = None
        self._job: CommandJob | None = None
        self._is_cancelled = False
        self._is_closed = False
        self._refused = 0.0

    @property
    def running(self) -> str:
        """What is being computed; empty if nothing is."""
        return self._name or ""

    @property
    def refusal(self) -> str:
        """Why no command can be started now; empty if one can."""
        if self._app.session.store.files.is_remote:
            return "a store on a server is only read: compute in the store that was pushed"
        if self._name is None:
            return ""
        return f"{self._name} is still being computed: start the next one when it is done"

    def start(
        self, name: str, start: Callable[[], CommandJob], missing: str,
        done: Callable[[], object],
    ) -> None:  # fmt: skip
        """Run a command in the background and call `done` after its success.

        `missing` describes the result that is missing until then. Raises RequestError while another
        command runs.
        """
        if self.refusal:
            self._refused = time.monotonic()
            raise RequestError(self.refusal)
        self._name, self._is_cancelled = name, False
        self._show(f"{name}: checking")
        self._app.jobs.start(partial(self._follow, name, start, done), missing)

    def _follow(
        self, name: str, start: Callable[[], CommandJob], done: Callable[[], object]
    ) -> None:
        """Runs in a background thread."""
        try:
            job = start()
        except Exception as error:  # reported on the screen, whatever it is
            reason = str(error) or type(error).__name__
            if isinstance(error, ModuleNotFoundError):
                reason = f"this needs {error.name}: pip install 's2rtui[tools]'"
            failed = JobProgress(None, "", "failed", reason)
            self._app.run_on_ui(self._show_progress, name, failed, done)
            return
        self._job = job
        if self._is_cancelled:
            job.cancel()
        for progress in job.follow():
            self._app.run_on_ui(self._show_progress, name, progress, done)
        if progress.outcome != "done" and self._is_closed:
            raise RequestError(f"{name}: cancelled")

    def cancel(self) -> None:
        """End the command; what it has published stays."""
        self._is_cancelled = True
        if self._job is not None:
            self._job.cancel()

    def close(self) -> None:
        """Cancel the command because the application ends."""
        self._is_closed = True
        self.cancel()

    def _show_progress(self, name: str, progress: JobProgress, done: Callable[[], object]) -> None:
        session = self._app.session
        if progress.is_running:
            is_old = time.monotonic() - self._refused > _SHOWN_SECONDS
            if session.state.message == self.refusal and is_old:
                session.show_message("")
            self._show(f"{name}: {progress.text}")
            self._app.updater.refresh_message()
            return
        self._name = self._job = None
        self._show("")
        if progress.outcome == "done":
            try:
                done()
            except (RequestError, OSError) as error:
                session.show_message(str(error), is_error=True)
        else:
            reason = progress.error or progress.outcome
            is_error = progress.outcome == "failed"
            session.show_message(f"{name}: {reason}", is_error=is_error)
        self._app.updater.refresh()

    def _show(self, text: str) -> None:
        self._app.loaded = replace(self._app.loaded, computation=text)
