"""Numbers of things in messages."""

from __future__ import annotations


def count_text(count: int, noun: str) -> str:
    """A number with its noun, such as `1 issue` or `3 issues`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
