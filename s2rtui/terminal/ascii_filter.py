"""Replace non-ASCII characters, as the last step before a line reaches the terminal."""

from __future__ import annotations

import unicodedata
from functools import lru_cache

from rich.cells import get_character_cell_size
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

_REPLACEMENTS = {
    "│": "|", "┃": "|", "▌": "|", "▐": "|", "▏": "|", "▎": "|", "▊": "|", "─": "-", "━": "-",
    "▁": "_", "▔": "-", "█": "#", "…": "~", "·": ".", "•": "*", "–": "-", "—": "-", "−": "-",
    "×": "x", "°": "d", "→": ">", "←": "<", "↑": "^", "↓": "v", "‘": "'", "’": "'", "“": '"',
    "”": '"',
}  # fmt: skip


def to_ascii(text: str) -> str:
    """Convert text to ASCII of the same width: drop accents, use `?` for other characters."""
    return text if text.isascii() else "".join(_character(char) for char in text)


@lru_cache(1024)
def _character(char: str) -> str:
    if char.isascii():
        return char
    width = get_character_cell_size(char)
    bare = unicodedata.normalize("NFKD", char)[:1]
    return _REPLACEMENTS.get(char, bare if bare.isascii() else "?").ljust(width, "?")[:width]


class AsciiFilter(LineFilter):
    """A Textual line filter that converts every line to ASCII."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        return [Segment(to_ascii(text), style, control) for text, style, control in segments]
