"""Text from a store or a user on its way to a terminal."""

from __future__ import annotations


def printable(text: str) -> str:
    """The text with every character that could steer a terminal replaced by U+FFFD.

    Line breaks and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else "\ufffd" for c in text)
