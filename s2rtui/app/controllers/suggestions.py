"""Apply the chosen answer of the suggestions view."""

from __future__ import annotations

from typing import TYPE_CHECKING

from s2rstore.suggestions import Answer
from s2rtui.charts.suggestions import VIEW as SUGGESTIONS
from s2rtui.session import adjusting, suggestions

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp


class SuggestionController:
    """Shows answers for real images as live adjustments, and copies the commands of others."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app

    def apply(self) -> None:
        """Apply the chosen answer, or say why there is none."""
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
                self._adjust(direction.answers[number], number)
            else:
                command = direction.commands[number]
                self._app.copy_to_clipboard(command)
                session.show_message(f"copied, to be run in a shell: {command}")
        self._app.updater.refresh()

    def _adjust(self, answer: Answer, number: int) -> None:
        """Open the sliders of the run at the values of an answer for its real images."""
        session = self._app.session
        if session.state.cursor is None:
            session.show_message("no instance to adjust: select some")
            return
        try:
            sliders, reason = adjusting.available_sliders(session.store, session.state.run)
        except ModuleNotFoundError as error:
            session.dispatch(adjusting.report_missing_package, str(error.name))
            self._app.navigation.show_view("adjust")
            return
        session.dispatch(adjusting.open_sliders, sliders, reason)
        session.dispatch(suggestions.adjust, "real", answer.chain)
        if not session.state.is_error:
            self._app.navigation.show_view("adjust")
            unsure = "" if answer.evident else " (not shown to help)"
            session.show_message(
                f"answer {number + 1}{unsure}: {answer.changes_text}; S saves it as a run"
            )
