"""The list of saved selections and of the history."""

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
from s2rtui.app.screens import ModalBase
from s2rtui.session import selection
from s2rtui.session.saved_selection_diff import summary
from s2rtui.session.session import Session
from s2rtui.session.shared_selection import shared_text
from s2rtui.user_data.notebook import reference

_MAX_HISTORY = 100
_TITLE = "saved selections and history"


class SelectionsScreen(ModalBase[str | None]):
    """Returns the chosen selection as text; d deletes a saved one."""

    BINDINGS: ClassVar[list[BindingType]] = [
        ("escape,f,q", "dismiss", "close"),
        ("d", "delete", "delete"),
    ]

    def __init__(self, session: Session) -> None:
        super().__init__()
        self._session = session
        self._texts: dict[str, str] = {}

    def compose(self) -> ComposeResult:
        with Vertical(id="selections"):
            yield Static(_TITLE, id="selections-title", markup=False)
            yield OptionList(id="selections-list", compact=True, markup=False)
            yield Static(
                "enter selects   d deletes a saved selection   escape closes", markup=False
            )

    def on_mount(self) -> None:
        self._list_options()
        self.query_one(OptionList).focus()

    def _list_options(self, at_row: int = 0) -> None:
        notes, state = self._session.notes, self._session.state
        options: list[Option] = []
        self._texts = {}
        for name, saved in notes.selections.items():
            label = f"{reference(name)}   {saved.expression}   {summary(saved)}"
            options.append(Option(Content(printable(label)), id=f"@{name}"))
            self._texts[f"@{name}"] = shared_text(saved, self._session.store.identity)
        past = dict.fromkeys(reversed((*notes.history, *state.expressions)))
        for number, expression in enumerate(list(past)[:_MAX_HISTORY]):
            options.append(Option(Content(printable(expression)), id=f"past-{number}"))
            self._texts[f"past-{number}"] = expression
        listed = self.query_one(OptionList)
        listed.clear_options()
        listed.add_options(options)
        listed.highlighted = min(at_row, len(options) - 1) if options else None

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(self._texts[event.option.id or ""])

    def action_delete(self) -> None:
        listed = self.query_one(OptionList)
        if listed.highlighted is None:
            return
        row = listed.highlighted
        option_id = listed.get_option_at_index(row).id or ""
        if not option_id.startswith("@"):
            self._show_title("only saved selections can be deleted, not the history")
            return
        try:
            self._session.writable_notebook.forget(option_id[1:])
        except (S2RError, OSError) as error:
            self._show_title(str(error))
        else:
            self._session.dispatch(selection.refresh)
            self._show_title(_TITLE)
        self._list_options(row)

    def _show_title(self, text: str) -> None:
        self.query_one("#selections-title", Static).update(Content(printable(text)))
