"""Runs on their way into the store, one at a time, followed until they are published."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from textual.message import Message

from s2rstore.errors import RequestError, S2RError
from s2rtui.app.controllers.base import Desk
from s2rtui.jobs.precompute_job import JobProgress, PrecomputeJob
from s2rtui.session import State


class Savings(Desk):
    """The run that this application is saving; the fresh one is saved, and yet to be told of."""

    _saved: str | None = None
    _saving: PrecomputeJob | None = None
    _fresh: str | None = None
    _left = False

    @dataclass
    class Told(Message):
        """How far a run is."""

        run: str
        progress: JobProgress

    @property
    def saving_refusal(self) -> str:
        """Why no run can be saved now; empty where one can."""
        if self._saved is None:
            return ""
        return f"run {self._saved} is still being saved: save the next one when it is done"

    def begin_saving(self, name: str, start: Callable[[], PrecomputeJob]) -> None:
        """Show how far a run is, and move on to its generation once it is published.

        Raises RequestError while another one is being saved.
        """
        if self.saving_refusal:
            raise RequestError(self.saving_refusal)
        self._saved = name
        self.resources = replace(self.resources, saving=f"run {name}: checking")
        again = shlex.join(["s2r", "precompute", str(self.session.store.path), "--run", name])
        self.in_background(
            partial(self._follow, name, start),
            f"run {name} is not saved yet: `{again}` goes on with it",
        )

    def _follow(self, name: str, start: Callable[[], PrecomputeJob]) -> None:
        """In a thread of its own."""
        try:
            saving = start()
        except ModuleNotFoundError as error:
            lacks = f"saving a run needs {error.name}: pip install 's2rtui[tools]'"
            self.post(self.Told(name, JobProgress(0.0, "", "failed", lacks)))
            return
        except Exception as error:  # whatever it was, the screen goes on and says so
            told = str(error) or type(error).__name__
            self.post(self.Told(name, JobProgress(0.0, "", "failed", told)))
            return
        self._saving = saving
        if self._left:
            saving.leave()
        for progress in saving.follow():
            self.post(self.Told(saving.run, progress))
        self._saving = None
        if progress.outcome != "done" and self._left:
            raise RequestError(f"run {name}: left")

    def leave_savings(self) -> None:
        """The application ends, and its saving with it."""
        self._left = True
        if self._saving is not None:
            self._saving.leave()

    def on_savings_told(self, message: Told) -> None:
        run, progress = message.run, message.progress
        if progress.is_running:
            told = f"run {run}: {progress.fraction:.0%}, {progress.stage}"
            self.resources = replace(self.resources, saving=told)
            self.show_message()
            return
        self._saved = None
        self.resources = replace(self.resources, saving="")
        if progress.outcome == "done":
            self._saved_as(run)
        else:
            why = progress.error or progress.outcome
            self.session.tell(f"run {run}: {why}", is_error=progress.outcome == "failed")
        self.refresh_views()

    def _saved_as(self, run: str) -> None:
        self._fresh = run
        try:
            self.session.move_on()
        except S2RError as error:
            self.session.tell(str(error), is_error=True)
        else:
            self.tell_saved()

    def tell_saved(self) -> None:
        """How to turn to the run that was saved, once its generation is open."""
        state, run = self.session.state, self._fresh
        if run is not None and run in state.runs and state.awaited is None:
            self._fresh = None
            self.session.tell(f"run {run} is saved{_turning(state, run)}")


def _turning(state: State, run: str) -> str:
    """What leads from the present run to another one."""
    steps = (state.runs.index(run) - state.runs.index(state.run)) % len(state.runs)
    if steps == 0:
        return ""
    key = "r" if steps == 1 else "R" if steps == len(state.runs) - 1 else ""
    return f": {key} turns to it" if key else ": a click on it in the overview turns to it"
