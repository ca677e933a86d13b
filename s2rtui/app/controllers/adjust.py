"""Live adjustments: open the sliders, apply suggestions, and save a run.

The run is computed in the background.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError, S2RError
from s2rstore.suggestions import Answer
from s2rtui.charts.suggestions import VIEW as SUGGESTIONS
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
                adjust = session.state.adjust
                if adjust is None or adjust.missing:
                    self._load_sliders()
                session.dispatch(view_settings.show_view, "adjust", "tab")

    def _load_sliders(self) -> bool:
        """Show the sliders of the present run; False where a package is missing, which is shown."""
        session = self._app.session
        try:
            sliders, reason = adjusting.available_sliders(session.store, session.state.run)
        except ModuleNotFoundError as error:
            session.dispatch(adjusting.report_missing_package, str(error.name))
            return False
        session.dispatch(adjusting.open_sliders, sliders, reason)
        return True

    def apply_answer(self) -> None:
        """Apply the chosen answer of the suggestions view, or say why there is none.

        Answers for real images become live adjustments; the commands of others are copied.
        """
        session = self._app.session
        reason = SUGGESTIONS.unavailable(session.store)
        chosen = None if reason else SUGGESTIONS.input(self._app.updater.scene).chosen_answer
        if reason:
            session.show_message(reason)
        elif chosen is None:
            session.show_message("there is no answer to apply")
        else:
            direction, number = chosen
            if direction.side == "real" and self._app.access.allows("models"):
                self._show_answer(direction.answers[number], number)
            else:
                command = direction.commands[number]
                self._app.copy_to_clipboard(command)
                session.show_message(f"copied, to be run in a shell: {command}")

    def _show_answer(self, answer: Answer, number: int) -> None:
        """Open the sliders of the run at the values of an answer for its real images."""
        session = self._app.session
        if session.state.cursor is None:
            session.show_message("no instance to adjust: select some")
            return
        if not self._load_sliders():
            self._app.navigation.show_view("adjust")
            return
        session.dispatch(adjusting.set_chain, "real", answer.chain)
        if not session.state.is_error:
            self._app.navigation.show_view("adjust")
            unsure = "" if answer.evident else " (not shown to help)"
            session.show_message(
                f"answer {number + 1}{unsure}: {answer.changes_text}; S saves it as a run"
            )

    def ask_name(self) -> None:
        """Ask for the name of a run to save. Raises RequestError while another one is saved."""
        adjust = self._app.session.state.adjust
        if adjust is None or not adjust.sliders:
            self._app.session.show_message("nothing to save: there are no sliders")
        elif self._refusal:
            raise RequestError(self._refusal)
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
        self._show_saving(f"run {name}: checking")
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
            failed = JobProgress(0.0, "", "failed", reason)
            self._app.run_on_ui(self.show_progress, name, failed)
            return
        self._job = job
        if self._is_closed:
            job.cancel()
        for progress in job.follow():
            self._app.run_on_ui(self.show_progress, job.run, progress)
        self._job = None
        if progress.outcome != "done" and self._is_closed:
            raise RequestError(f"run {name}: cancelled")

    def close(self) -> None:
        """Cancel the computation because the application ends."""
        self._is_closed = True
        if self._job is not None:
            self._job.cancel()

    def show_progress(self, run: str, progress: JobProgress) -> None:
        """Show how far the computation of a run is, or its outcome."""
        session = self._app.session
        if progress.is_running:
            self._show_saving(f"run {run}: {progress.fraction:.0%}, {progress.stage}")
            self._app.updater.refresh_message()
            return
        self._saving = None
        self._show_saving("")
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

    def _show_saving(self, text: str) -> None:
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
