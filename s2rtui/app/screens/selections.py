"""The saved selections and the history, to choose from."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from s2rstore.errors import S2RError
from s2rstore.security.printable_text import printable
from s2rtui.app.screens.modal import ModalBase
from s2rtui.session import Session
from s2rtui.session.saved_selection_diff import where
from s2rtui.session.shared_selection import written
from s2rtui.user_data.notebook import reference

_MOST = 100
_TITLE = "saved selections and history"


class SelectionsScreen(ModalBase[str | None]):
    """Enter takes a selection, d forgets a saved one, escape leaves."""

    BINDINGS: ClassVar[list[BindingType]] = [
        ("escape,f,q", "dismiss", "close"),
        ("d", "forget", "forget"),
    ]

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self._texts: dict[str, str] = {}

    def compose(self) -> ComposeResult:
        with Vertical(id="selections"):
            yield Static(_TITLE, id="selections-title", markup=False)
            yield OptionList(id="selections-list", compact=True, markup=False)
            yield Static("enter takes one   d forgets a saved one   escape leaves", markup=False)

    def on_mount(self) -> None:
        self._fill()
        self.query_one(OptionList).focus()

    def _fill(self, at_row: int = 0) -> None:
        notes, state = self._session.notes, self._session.state
        options: list[Option] = []
        self._texts = {}
        for name, saved in notes.selections.items():
            label = f"{reference(name)}   {saved.expression}   {where(saved)}"
            options.append(Option(Content(printable(label)), id=f"@{name}"))
            self._texts[f"@{name}"] = written(saved, self._session.store.dataset.hash)
        past = dict.fromkeys(reversed((*notes.history, *state.past, state.expression)))
        for number, expression in enumerate(list(past)[:_MOST]):
            options.append(Option(Content(printable(expression)), id=f"past-{number}"))
            self._texts[f"past-{number}"] = expression
        listed = self.query_one(OptionList)
        listed.clear_options()
        listed.add_options(options)
        listed.highlighted = min(at_row, len(options) - 1) if options else None

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(self._texts[event.option.id or ""])

    def action_forget(self) -> None:
        listed = self.query_one(OptionList)
        if listed.highlighted is None:
            return
        row = listed.highlighted
        chosen = listed.get_option_at_index(row).id or ""
        if not chosen.startswith("@"):
            self._say("history is not forgotten: only saved selections are")
            return
        try:
            self._session.book.forget(chosen[1:])
        except (S2RError, OSError) as error:
            self._say(str(error))
        else:
            self._session.renew()
            self._say(_TITLE)
        self._fill(row)

    def _say(self, words: str) -> None:
        self.query_one("#selections-title", Static).update(Content(printable(words)))
