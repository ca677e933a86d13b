"""The input line: expressions, names of selections, notes and tags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from textual.widgets import Input

from s2rstore.errors import RequestError, S2RError
from s2rstore.language import ExpressionError, complete, evaluation
from s2rtui.app.screens.selections import SelectionsScreen
from s2rtui.app.widgets.query_input import Complete, QueryInput
from s2rtui.session import selection, shared_selection
from s2rtui.user_data.notebook import Remark, reference, valid_name

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

Accept = Callable[[str], object]
_MAX_OFFERS = 6
_MAX_TAGGED = 2000
"""Instances tagged at a time; each becomes an entry of the notebook."""


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
        self._app.renderer.refresh()

    def submit(self, event: Input.Submitted) -> None:
        """Pass the text on; if it cannot be used, show why and keep the line open."""
        if self._accept is None:
            return
        try:
            self._accept(event.value)
        except (S2RError, OSError) as error:
            self._app.session.show_message(str(error), is_error=True)
            if isinstance(error, ExpressionError):
                event.input.cursor_position = min(error.column - 1, len(event.value))
            self._app.renderer.refresh_message()
            return
        self._close()

    def show_completions(self, message: QueryInput.Offered) -> None:
        """Show the first completions in the message line."""
        offers = [f"{word} ({meaning})" for word, meaning in message.options[:_MAX_OFFERS]]
        more = len(message.options) - _MAX_OFFERS
        text = "  ".join(offers) + (f"  and {more} more" if more > 0 else "")
        self._app.session.show_message(text or "no completion")
        self._app.renderer.refresh_message()

    # --- expressions -------------------------------------------------------------------------

    def edit_expression(self) -> None:
        """Edit the present expression, with history and completion."""
        self._reload_notes()
        session = self._app.session
        state, notes = session.state, session.notes
        history = list(dict.fromkeys((*notes.history, *state.past, state.expression)))
        accept = partial(session.dispatch, shared_selection.select_text)
        self.ask(accept, state.expression, "worst15 & room:right", history, self._completions)

    def _completions(self, text: str) -> list[tuple[str, str]]:
        session = self._app.session
        return complete(text, evaluation.vocabulary(session.store, session.notes.nodes))

    def _reload_notes(self) -> None:
        """Read the changes of other sessions of this user."""
        if self._app.session.notebook is not None:
            try:
                self._app.session.notebook.refresh()
            except S2RError as error:
                self._app.session.show_message(str(error), is_error=True)

    def choose_selection(self) -> None:
        """Choose from the saved selections and the history."""
        self._reload_notes()
        self._app.push_screen(SelectionsScreen(self._app.session), self._select_chosen)

    def _select_chosen(self, text: str | None) -> None:
        if text is not None:
            try:
                self._app.session.dispatch(shared_selection.select_text, text)
            except S2RError as error:
                self._app.session.show_message(str(error), is_error=True)
        self._app.renderer.refresh()

    # --- the notebook ------------------------------------------------------------------------

    def save_selection(self) -> None:
        """Save the selection under a name."""
        self.ask(self._save_selection, "", "a name for this selection: it becomes @name")

    def _save_selection(self, name: str) -> None:
        session = self._app.session
        saved = shared_selection.current_selection(session.state)
        session.writable_notebook.save(name, saved)
        self._confirm(f"saved as {reference(valid_name(name, 'name'))}")

    def _confirm(self, text: str) -> None:
        """Show a message, unless the selection can no longer be evaluated: that is shown then."""
        session = self._app.session
        before = session.state
        after = session.dispatch(selection.refresh)
        if after is before or not after.is_error:
            session.show_message(text)

    def _cursor(self, purpose: str) -> int | None:
        """The present instance; a message says so if there is none."""
        if (iid := self._app.session.state.cursor) is None:
            self._app.session.show_message(f"no instance for a {purpose}: select some")
            self._app.renderer.refresh()
        return iid

    def edit_note(self) -> None:
        """Edit the note on the present instance."""
        if (iid := self._cursor("note")) is None:
            return
        note = self._app.session.notes.remarks.get(iid, Remark()).note
        self.ask(partial(self._save_note, iid), note, f"a note on instance {iid}")

    def _save_note(self, iid: int, text: str) -> None:
        self._app.session.writable_notebook.note(iid, text)
        self._app.session.show_message("")

    def edit_tag(self) -> None:
        """Set or remove a tag of the present instance, or of the whole selection."""
        if (iid := self._cursor("tag")) is None:
            return
        hint = f"a tag for instance {iid}; add * to tag the whole selection"
        tags = sorted({t for r in self._app.session.notes.remarks.values() for t in r.tags})
        self.ask(partial(self._toggle_tag, iid), "", hint, tags)

    def _toggle_tag(self, iid: int, text: str) -> None:
        for_all = text.rstrip().endswith("*")
        iids = self._selected_iids() if for_all else [iid]
        is_set = self._app.session.writable_notebook.toggle_tag(iids, text.rstrip().rstrip("*"))
        tagged = f"{len(iids)} instances" if for_all else f"instance {iid}"
        self._confirm(f"{'tagged' if is_set else 'tag removed'}: {tagged}")

    def _selected_iids(self) -> list[int]:
        """The selected iids; raises RequestError for none, or too many for a notebook."""
        iids = np.flatnonzero(self._app.session.state.selected)
        if not iids.size:
            raise RequestError("nothing is selected: there is no instance to tag")
        if iids.size > _MAX_TAGGED:
            raise RequestError(
                f"{iids.size} instances are too many to tag (at most {_MAX_TAGGED}): "
                "@ saves the selection under a name"
            )
        return [int(iid) for iid in iids]
