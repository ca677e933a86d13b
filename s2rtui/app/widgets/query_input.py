"""The input line at the foot, with history and completion."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widgets import Input

_WORD = re.compile(r"\A[\w.]+")
_LAST = re.compile(r'(?:"(?:\\.|[^"\\])*"|[^\s"])+\s*\Z')
Complete = Callable[[str], Sequence[tuple[str, str]]]


class QueryInput(Input):
    """Up and down recall earlier lines, tab completes; a closed line takes no focus."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+u", "delete_line", "delete the line", show=False),
        Binding("up", "earlier", "earlier line", show=False),
        Binding("down", "later", "later line", show=False),
        Binding("tab", "complete(1)", "complete", show=False),
        Binding("shift+tab", "complete(-1)", "complete", show=False),
    ]

    @dataclass
    class Offered(Message):
        """Completions at the cursor: pairs of a word and its meaning."""

        options: Sequence[tuple[str, str]]

    def __init__(self) -> None:
        super().__init__(id="query", select_on_focus=False)
        self.cursor_blink = False
        self._complete: Complete = lambda text: ()
        self._completes = False
        self._history: Sequence[str] = ()
        self._place = 0
        self._draft = ""
        self._options: Sequence[tuple[str, str]] = ()
        self._option = -1
        self._rest = ""
        self._filled: tuple[str, int] | None = None

    @property
    def keys(self) -> list[tuple[str, str]]:
        """(key, label) pairs for the footer while the line is open."""
        completing = [("tab", "complete")] if self._completes else []
        earlier = [("up", "earlier")] if self._history else []
        return [("enter", "done"), *completing, *earlier, ("escape", "cancel")]

    def on_mount(self) -> None:
        self.can_focus = False

    def open(
        self, value: str, hint: str, history: Sequence[str] = (), complete: Complete | None = None
    ) -> None:
        """Open the line with a value; `history` has the latest line last."""
        self._history, self._place = history, len(history)
        self._complete, self._completes = complete or (lambda text: ()), complete is not None
        self._options, self._option = (), -1
        self.placeholder = hint
        self.value = value
        self.cursor_position = len(value)
        self.can_focus = True
        self.add_class("open")
        self.focus()

    def close(self) -> None:
        self.remove_class("open")
        self.can_focus = False
        self.screen.set_focus(None)

    def action_delete_line(self) -> None:
        """Delete the whole line, wherever the cursor is."""
        self.value = ""

    def action_earlier(self) -> None:
        if self._place == len(self._history):
            self._draft = self.value
        self._go(self._place - 1)

    def action_later(self) -> None:
        self._go(self._place + 1)

    def _go(self, place: int) -> None:
        if 0 <= place <= len(self._history):
            self._place = place
            self._fill([*self._history, self._draft][place])

    def action_complete(self, steps: int) -> None:
        """Replace the word at the cursor by the next completion."""
        if not self._options or self._filled != (self.value, self.cursor_position):
            at = self.cursor_position
            head, rest = self.value[:at], _WORD.sub("", self.value[at:], count=1)
            self._options = tuple(self._complete(head))
            self._option, self._rest = -1, rest if rest.strip() else ""
            offered = [(_last(text), meaning) for text, meaning in self._options]
            self.post_message(self.Offered(offered))
        if self._options:
            first = self._option < 0 and steps < 0
            self._option = (self._option + steps + first) % len(self._options)
            text = self._options[self._option][0]
            self._fill(text + self._rest)
            self.cursor_position = len(text)
            self._filled = self.value, self.cursor_position

    def _fill(self, text: str) -> None:
        self.value = text
        self.cursor_position = len(text)

    def on_key(self, event: events.Key) -> None:
        if event.key not in ("tab", "shift+tab"):
            self._options, self._option = (), -1


def _last(text: str) -> str:
    """The last word of a line, including quoted blanks."""
    match = _LAST.search(text)
    return match.group().strip() if match else text
