"""Modal screens: help, tour, doctor, jump, saved selections; and their base class."""

from __future__ import annotations

from typing import TypeVar

from textual.await_complete import AwaitComplete
from textual.screen import ModalScreen

T = TypeVar("T")


class ModalBase(ModalScreen[T]):
    """A modal screen that is dismissed once, however many keys arrive at the same time."""

    def dismiss(self, result: T | None = None) -> AwaitComplete:
        if self.app.screen_stack[-1:] != [self]:
            return AwaitComplete()
        return super().dismiss(result)
