"""A line of text: the status line, the message line and the footer."""

from __future__ import annotations

from textual.content import Content
from textual.widgets import Static

from s2rstore.security.printable_text import printable

Piece = str | tuple[str, str]
"""Text, or text with a style such as `bold`."""


class Bar(Static):
    """Updates only when its content changes; no text in it is markup."""

    def __init__(self, name: str) -> None:
        super().__init__("", id=name, markup=False)
        self._pieces: tuple[Piece, ...] = ()

    def show(self, *pieces: Piece, classes: str = "") -> None:
        """Show pieces of text, with CSS classes for the whole line."""
        if pieces != self._pieces:
            self._pieces = pieces
            self.update(Content.assemble(*(_printable_piece(piece) for piece in pieces)))
        self.set_classes(classes)


def _printable_piece(piece: Piece) -> Piece:
    return printable(piece) if isinstance(piece, str) else (printable(piece[0]), piece[1])
