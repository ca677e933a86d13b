"""Live adjustments: open the sliders, and save them as a run that is computed in the background."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError, S2RError
from s2rtui.app.messages import AdjustmentProgressed
from s2rtui.jobs.precompute_job import JobProgress, PrecomputeJob, save_run
from s2rtui.session import adjusting, view_settings
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp


class AdjustController:
    """Saves one run at a time and follows its computation until it is published."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._saving: str | None = None
        self._job: PrecomputeJob | None = None
        self._unannounced: str | None = None
        """A published run whose generation is not open yet."""
        self._is_closed = False

    def open_sliders(self) -> None:
        """Open the panel for live adjustments."""
        session = self._app.session
        if session.state.view != "adjust":
            if session.state.cursor is None:
                session.show_message("no instance to adjust: select some")
            else:
                self._load_sliders()
                session.dispatch(view_settings.show_view, "adjust", "tab")
        self._app.updater.refresh()

    def _load_sliders(self) -> None:
        session = self._app.session
        adjust = session.state.adjust
        if adjust is not None and not adjust.missing:
            return
        try:
            sliders, reason = adjusting.available_sliders(session.store, session.state.run)
        except ModuleNotFoundError as error:
            session.dispatch(adjusting.report_missing_package, str(error.name))
        else:
            session.dispatch(adjusting.open_sliders, sliders, reason)

    def ask_name(self) -> None:
        """Ask for the name under which the adjustments are saved as a run."""
        adjust = self._app.session.state.adjust
        if adjust is None or not adjust.sliders:
            self._app.session.show_message("nothing to save: there are no sliders")
            self._app.updater.refresh()
        elif self._refusal:
            self._app.show_error(self._refusal)
        else:
            hint = "a name for the run with these adjustments"
            self._app.prompt.ask(self._save_adjustments, "", hint)

    def _save_adjustments(self, name: str) -> None:
        adjust, name = self._app.session.state.adjust, name.strip()
        if not name:
            raise RequestError("type a name for the run")
        if adjust is not None:
            store = self._app.session.store
            root, chains = store.path, adjusting.adjustment_chains(store, adjust)
            self.save(name, partial(save_run, root, name, adjust.run, chains))
        self._app.session.show_message("")

    @property
    def _refusal(self) -> str:
        """Why no run can be saved now; empty if one can."""
        if self._app.session.store.files.is_remote:
            return "a store on a server is only read: save runs in the store that was pushed"
        if self._saving is None:
            return ""
        return f"run {self._saving} is still being saved: save the next one when it is done"

    def save(self, name: str, start: Callable[[], PrecomputeJob]) -> None:
        """Compute a run in the background and open its generation once it is published.

        Raises RequestError while another run is being saved.
        """
        if self._refusal:
            raise RequestError(self._refusal)
        self._saving = name
        self._show_progress(f"run {name}: checking")
        path = str(self._app.session.store.path)
        command = shlex.join(["s2r", "precompute", path, "--run", name])
        missing = f"run {name} is not saved yet: `{command}` completes it"
        self._app.jobs.start(partial(self._follow, name, start), missing)

    def _follow(self, name: str, start: Callable[[], PrecomputeJob]) -> None:
        """Runs in a background thread."""
        try:
            job = start()
        except Exception as error:  # reported on the screen, whatever it is
            reason = str(error) or type(error).__name__
            if isinstance(error, ModuleNotFoundError):
                reason = f"saving a run needs {error.name}: pip install 's2rtui[tools]'"
            self._app.post(AdjustmentProgressed(name, JobProgress(0.0, "", "failed", reason)))
            return
        self._job = job
        if self._is_closed:
            job.cancel()
        for progress in job.follow():
            self._app.post(AdjustmentProgressed(job.run, progress))
        self._job = None
        if progress.outcome != "done" and self._is_closed:
            raise RequestError(f"run {name}: cancelled")

    def close(self) -> None:
        """Cancel the computation because the application ends."""
        self._is_closed = True
        if self._job is not None:
            self._job.cancel()

    def on_progressed(self, message: AdjustmentProgressed) -> None:
        """Show the progress, or the outcome."""
        run, progress, session = message.run, message.progress, self._app.session
        if progress.is_running:
            self._show_progress(f"run {run}: {progress.fraction:.0%}, {progress.stage}")
            self._app.updater.refresh_message()
            return
        self._saving = None
        self._show_progress("")
        if progress.outcome == "done":
            self._unannounced = run
            try:
                session.open_newest_generation()
            except S2RError as error:
                session.show_message(str(error), is_error=True)
            else:
                self.announce()
        else:
            reason = progress.error or progress.outcome
            session.show_message(f"run {run}: {reason}", is_error=progress.outcome == "failed")
        self._app.updater.refresh()

    def _show_progress(self, text: str) -> None:
        self._app.loaded = replace(self._app.loaded, saving=text)

    def announce(self) -> None:
        """Say how to show the saved run, once its generation is open."""
        state, run = self._app.session.state, self._unannounced
        if run is not None and run in state.runs and state.pending is None:
            self._unannounced = None
            self._app.session.show_message(f"run {run} is saved{_how_to_show(state, run)}")


def _how_to_show(state: State, run: str) -> str:
    steps = (state.runs.index(run) - state.runs.index(state.run)) % len(state.runs)
    if steps == 0:
        return ""
    key = "r" if steps == 1 else "R" if steps == len(state.runs) - 1 else ""
    return f": {key} shows it" if key else ": click on it in the overview to show it"
