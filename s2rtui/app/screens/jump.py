"""Jump mode: a letter on every target of the screen; pressing it goes there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from textual import events
from textual.app import ComposeResult
from textual.geometry import Offset
from textual.widgets import Label

from s2rtui.app.screens import ModalBase

LETTERS = "asdfghjklqwertyuiopzxcvbnm"


@dataclass(frozen=True, slots=True)
class JumpTarget:
    """A cell of the screen, and the action that a jump to it runs."""

    x: int
    y: int
    action: str


class JumpScreen(ModalBase[str | None]):
    """Returns the action of the pressed letter, None for any other key."""

    def __init__(self, targets: Sequence[JumpTarget]) -> None:
        super().__init__()
        self._targets = dict(zip(LETTERS, targets, strict=False))

    def compose(self) -> ComposeResult:
        for letter, target in self._targets.items():
            label = Label(f" {letter} ", classes="jump", markup=False)
            label.absolute_offset = Offset(target.x, target.y)
            yield label

    def on_key(self, event: events.Key) -> None:
        event.stop()
        target = self._targets.get(event.character or "")
        self.dismiss(target.action if target else None)
