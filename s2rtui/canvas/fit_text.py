"""Fit text into cells: no part of a number is shown, and no half of a wide character."""

from __future__ import annotations

import re

from rich.cells import cell_len, chop_cells, set_cell_size

NO_BREAK = "\u00a0"
"""A blank at which texts are not wrapped, as between a number and its unit."""
_NUMBER = re.compile(r"[-+−<>≤≥~#±]*\d[\w.,:%°]*(?:(?<=e)[-+]\d+)?")
"""A number with its sign and what is written directly after it, such as a unit."""


def fit_text(text: str, width: int, ellipsis: str = "") -> str:
    """The start of a text in at most `width` cells; `ellipsis` marks that something is left out.

    A number that does not fit whole is left out.
    """
    if cell_len(text) <= width:
        return text
    room = width - cell_len(ellipsis)
    if room < 0:
        return ""
    kept = set_cell_size(text, room) if room else ""
    end = _common_length(text, kept)
    for number in _NUMBER.finditer(text):
        if number.start() < end < number.end():
            kept = text[: number.start()]
            break
    return kept + ellipsis if ellipsis else kept.rstrip()


def wrap_text(text: str, width: int, indent: str = "") -> list[str]:
    """The words of a text in lines of at most `width` cells; `indent` begins all but the first.

    Only a word that is wider is divided, where it has some at blanks that join words.
    """
    lines: list[str] = []
    start = text[: len(text) - len(text.lstrip(" "))]
    room = max(1, width - max(len(start), len(indent)))
    for word in re.findall(r"[^ \t\n]+", text):
        if lines and cell_len(lines[-1]) + 1 + cell_len(word) <= width:
            lines[-1] += f" {word}"
            continue
        words, parts = word.replace(NO_BREAK, " "), [word]
        if cell_len(word) > room:
            parts = chop_cells(word, room) if words == word else wrap_text(words, room)
        for part in parts:
            lines.append((indent if lines else start) + part)
    return lines


def _common_length(text: str, start: str) -> int:
    """The number of characters at the start of both."""
    pairs = zip(text, start, strict=False)
    return next((at for at, pair in enumerate(pairs) if pair[0] != pair[1]), len(start))


def without_cut_numbers(text: str, skipped: int, width: int) -> str:
    """A text of which cells before `skipped` and from `skipped + width` on are not shown.

    Numbers that lie partly outside become blanks.
    """

    def blank(number: re.Match[str]) -> str:
        first = cell_len(text[: number.start()])
        last = first + cell_len(number[0])
        outside = last <= skipped or first >= skipped + width
        is_cut = not outside and (first < skipped or last > skipped + width)
        return " " * (last - first) if is_cut else number[0]

    return _NUMBER.sub(blank, text)
