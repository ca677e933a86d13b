"""One line of text pieces: status above, keys and messages below."""

from __future__ import annotations

from textual.widgets import Static


class Bar(Static):
    """A line whose content is replaced only when it changes."""

    def __init__(self, name: str) -> None:
        super().__init__("", id=name, markup=True)
        self._shown: str | None = None

    def say(self, markup: str, classes: str = "") -> None:
        """Show Textual markup, with CSS classes for its meaning."""
        if markup != self._shown:
            self._shown = markup
            self.update(markup)
        self.set_classes(classes)
