"""The help screen: questions, all keys from the action registry, terms; with a search."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.widgets import Input, Static

from s2rstore.security.printable_text import printable_lines
from s2rtui.app.screens import ModalBase
from s2rtui.app.screens.help_content import help_lines
from s2rtui.security import Permissions

_HINT = "/ searches   up and down scroll   escape closes"
_SEARCH_HINT = "a word or a key   enter goes to the first match   escape shows all"


class HelpScreen(ModalBase[None]):
    """Lists all actions; up and down scroll, `/` leaves the entries that match a text.

    Enter then shows the whole list at the first match, escape from the start.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        ("escape", "leave", "close"),
        ("question_mark,q,enter", "dismiss", "close"),
        ("slash", "search", "search"),
    ]

    def __init__(self, access: Permissions) -> None:
        super().__init__()
        self._access = access

    def compose(self) -> ComposeResult:
        with Vertical(id="help-frame"):
            with VerticalScroll(id="help"):
                yield Static(markup=False, id="help-text")
            yield Input(id="help-search", select_on_focus=False)
            yield Static(_HINT, id="help-hint", markup=False)

    def on_mount(self) -> None:
        self._show(help_lines(self._access))
        self._list.focus()

    @property
    def _list(self) -> VerticalScroll:
        return self.query_one("#help", VerticalScroll)

    @property
    def _line(self) -> Input:
        return self.query_one("#help-search", Input)

    def _show(self, lines: list[str], match: int | None = None) -> None:
        """Show lines, with the one of a match in bold."""
        text = printable_lines("\n".join(lines) or "nothing matches")
        before = len(text) if match is None else sum(len(line) + 1 for line in lines[:match])
        after = before if match is None else before + len(lines[match])
        self.query_one("#help-text", Static).update(
            Content.assemble(text[:before], (text[before:after], "bold reverse"), text[after:])
        )

    def action_search(self) -> None:
        """Open the search line."""
        self._line.add_class("open")
        self._line.value = ""
        self._line.focus()
        self.query_one("#help-hint", Static).update(Content(_SEARCH_HINT))

    def on_input_changed(self, event: Input.Changed) -> None:
        event.stop()
        self._show(help_lines(self._access, event.value.strip()))
        self._list.scroll_home(animate=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Show all lines, scrolled to the first one that matches."""
        event.stop()
        found = [line for line in help_lines(self._access, event.value.strip()) if line[:1] == " "]
        self._close_search()
        if found and event.value.strip():
            lines = help_lines(self._access)
            at = lines.index(found[0])
            self._show(lines, at)
            self.call_after_refresh(self._list.scroll_to, y=max(0, at - 2), animate=False)

    def action_leave(self) -> None:
        """Leave the search, or close the help."""
        if self._line.has_class("open"):
            self._close_search()
        else:
            self.dismiss()

    def _close_search(self) -> None:
        self._line.remove_class("open")
        self._show(help_lines(self._access))
        self.query_one("#help-hint", Static).update(Content(_HINT))
        self._list.focus()
