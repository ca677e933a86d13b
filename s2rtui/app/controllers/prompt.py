"""The input line, and the expression that is typed in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from textual.widgets import Input

from s2rstore.errors import S2RError
from s2rstore.language import ExpressionError, complete, evaluation
from s2rtui.app.widgets.query_input import Complete, QueryInput
from s2rtui.session import shared_selection

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

Accept = Callable[[str], object]
_MAX_OFFERS = 6


class PromptController:
    """Opens the input line for one purpose at a time and handles its text."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._accept: Accept | None = None

    @property
    def is_open(self) -> bool:
        """Whether the input line is open."""
        return self._accept is not None

    def ask(
        self,
        accept: Accept,
        value: str,
        hint: str,
        history: Sequence[str] = (),
        complete: Complete | None = None,
    ) -> None:
        """Open the line; `accept` gets its text and raises if it cannot be used."""
        self._accept = accept
        self._app.query_line.open(value, hint, history, complete)

    def cancel(self) -> None:
        """Close the line and clear the message about it."""
        self._app.session.show_message("")
        self._close()

    def _close(self) -> None:
        self._accept = None
        self._app.query_line.close()
        self._app.updater.refresh()

    def submit(self, event: Input.Submitted) -> None:
        """Pass the text on; if it cannot be used, show why and keep the line open."""
        if self._accept is None:
            return
        self._app.session.show_message("")
        try:
            self._accept(event.value)
        except (S2RError, OSError) as error:
            self._app.session.show_message(str(error), is_error=True)
            if isinstance(error, ExpressionError):
                event.input.cursor_position = min(error.column - 1, len(event.value))
            self._app.updater.refresh_message()
            return
        self._close()

    def show_completions(self, message: QueryInput.Offered) -> None:
        """Show the first completions in the message line."""
        offers = [f"{word} ({meaning})" for word, meaning in message.options[:_MAX_OFFERS]]
        more = len(message.options) - _MAX_OFFERS
        text = "  ".join(offers) + (f"  and {more} more" if more > 0 else "")
        self._app.session.show_message(text or "no completion")
        self._app.updater.refresh_message()

    def edit_expression(self) -> None:
        """Edit the present expression, with history and completion."""
        self.reload_notes()
        session = self._app.session
        state, notes = session.state, session.notes
        history = list(dict.fromkeys((*notes.history, *state.expressions)))
        accept = partial(session.dispatch, shared_selection.select_text)
        self.ask(accept, state.expression, "worst15 & room:right", history, self._completions)

    def _completions(self, text: str) -> list[tuple[str, str]]:
        session = self._app.session
        return complete(text, evaluation.vocabulary(session.store, session.notes.nodes))

    def reload_notes(self) -> None:
        """Read the changes of other sessions of this user."""
        if self._app.session.notebook is not None:
            try:
                self._app.session.notebook.refresh()
            except S2RError as error:
                self._app.session.show_message(str(error), is_error=True)
