"""Saved selections, notes and tags: what the user writes to the notebook."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.errors import RequestError, S2RError
from s2rtui.app.screens.selections import SelectionsScreen
from s2rtui.session import selection, shared_selection
from s2rtui.user_data.notebook import Remark, reference, valid_name

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

_MAX_TAGGED = 2000
"""Instances tagged at a time; each becomes an entry of the notebook."""


class AnnotationController:
    """Opens the input line for names, notes and tags, and writes them to the notebook."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app

    def choose_selection(self) -> None:
        """Choose from the saved selections and the history."""
        self._app.prompt.reload_notes()
        self._app.push_screen(SelectionsScreen(self._app.session), self._select_chosen)

    def _select_chosen(self, text: str | None) -> None:
        if text is not None:
            try:
                self._app.session.dispatch(shared_selection.select_text, text)
            except S2RError as error:
                self._app.session.show_message(str(error), is_error=True)
        self._app.updater.refresh()

    def save_selection(self) -> None:
        """Save the selection under a name."""
        self._app.prompt.ask(
            self._save_selection, "", "a name for this selection: it becomes @name"
        )

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
        return iid

    def edit_note(self) -> None:
        """Edit the note on the present instance."""
        if (iid := self._cursor("note")) is None:
            return
        note = self._app.session.notes.remarks.get(iid, Remark()).note
        self._app.prompt.ask(partial(self._save_note, iid), note, f"a note on instance {iid}")

    def _save_note(self, iid: int, text: str) -> None:
        self._app.session.writable_notebook.note(iid, text)
        self._app.session.show_message("")

    def edit_tag(self) -> None:
        """Set or remove a tag of the present instance, or of the whole selection."""
        if (iid := self._cursor("tag")) is None:
            return
        hint = f"a tag for instance {iid}; add * to tag the whole selection"
        tags = sorted({t for r in self._app.session.notes.remarks.values() for t in r.tags})
        self._app.prompt.ask(partial(self._toggle_tag, iid), "", hint, tags)

    def _toggle_tag(self, iid: int, text: str) -> None:
        for_all = text.rstrip().endswith("*")
        iids = self._selected_iids() if for_all else [iid]
        is_set = self._app.session.writable_notebook.toggle_tag(iids, text.rstrip().rstrip("*"))
        tagged = f"{len(iids)} instances" if for_all else f"instance {iid}"
        self._confirm(f"{'tagged' if is_set else 'tag removed'}: {tagged}")

    def _selected_iids(self) -> list[int]:
        """The selected iids; raises RequestError for none, or too many for a notebook."""
        iids = np.flatnonzero(self._app.session.state.chosen)
        if not iids.size:
            raise RequestError("nothing is selected: there is no instance to tag")
        if iids.size > _MAX_TAGGED:
            raise RequestError(
                f"{iids.size} instances are too many to tag (at most {_MAX_TAGGED}): "
                "@ saves the selection under a name"
            )
        return [int(iid) for iid in iids]
