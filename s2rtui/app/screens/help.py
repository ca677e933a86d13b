"""The help screen: all keys, generated from the action registry, and a glossary."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from s2rstore.security.printable_text import printable_lines
from s2rtui.app.key_bindings import help_text
from s2rtui.app.screens import ModalBase
from s2rtui.security import Permissions


class HelpScreen(ModalBase[None]):
    """Lists all actions; up and down scroll."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape,question_mark,q,enter", "dismiss", "close")]

    def __init__(self, access: Permissions) -> None:
        super().__init__()
        self._access = access

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="help"):
            yield Static(printable_lines(help_text(self._access)), markup=False)

    def on_mount(self) -> None:
        self.query_one("#help", VerticalScroll).focus()
