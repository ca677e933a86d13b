"""Live adjustments: open the sliders, apply suggestions, and save a run.

The run is computed in the background.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rstore.suggestions import Answer
from s2rtui.charts.suggestions import VIEW as SUGGESTIONS
from s2rtui.jobs.command_job import CommandJob
from s2rtui.jobs.precompute_job import save_run
from s2rtui.session import adjusting, view_settings
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp


class AdjustController:
    """Shows sliders, and answers of the suggestions as their values; saves them as a run."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._unannounced: str | None = None
        """A published run whose generation is not open yet."""

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
        elif refusal := self._app.computation.refusal:
            raise RequestError(refusal)
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

    def save(self, name: str, start: Callable[[], CommandJob]) -> None:
        """Compute a run in the background and open its generation once it is published.

        Raises RequestError while something else is computed.
        """
        path = str(self._app.session.store.path)
        command = shlex.join(["s2r", "precompute", path, "--run", name])
        missing = f"run {name} is not saved yet: `{command}` completes it"
        self._app.computation.start(f"run {name}", start, missing, partial(self.open_saved, name))

    def open_saved(self, run: str) -> None:
        """Open the generation of a saved run, and say how to show the run."""
        self._unannounced = run
        self._app.session.open_newest_generation()
        self.announce()

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
