"""One line of text pieces: status above, keys and messages below."""

from __future__ import annotations

from textual.content import Content
from textual.widgets import Static

from s2rstore.security.printable_text import printable

Piece = str | tuple[str, str]
"""Text, or text with a style such as `bold`."""


class Bar(Static):
    """A line whose content is replaced only when it changes; no text in it is markup."""

    def __init__(self, name: str) -> None:
        super().__init__("", id=name, markup=False)
        self._shown: tuple[Piece, ...] = ()

    def say(self, *pieces: Piece, classes: str = "") -> None:
        """Show pieces of text, with CSS classes for the meaning of the line."""
        if pieces != self._shown:
            self._shown = pieces
            self.update(Content.assemble(*(_safe(piece) for piece in pieces)))
        self.set_classes(classes)


def _safe(piece: Piece) -> Piece:
    return printable(piece) if isinstance(piece, str) else (printable(piece[0]), piece[1])
