"""Make text from outside (a store, a file, a user) safe to print.

Characters that are not printable (`str.isprintable`: control characters, escape sequences,
bidirectional overrides, line separators, invisible spaces) become a visible escape such as `\\x1b`
or `\\u202e`, as Python's `repr` writes them. Printable text is returned unchanged.
"""

from __future__ import annotations

import re
from typing import Any, TextIO, cast

_NOT_PLAIN = re.compile(r"[^\x20-\x7e]")


def printable(text: str) -> str:
    """One line without control characters; a line break becomes `\\n`, a tab `\\t`."""
    return text if text.isprintable() else _NOT_PLAIN.sub(_escape, text)


def printable_lines(text: str) -> str:
    """The same for text of several lines: line feeds and tabs stay."""
    if text.isprintable():
        return text
    return _NOT_PLAIN.sub(lambda match: match[0] if match[0] in "\n\t" else _escape(match), text)


def printable_values(value: Any) -> Any:
    """Parsed JSON with every string in it, keys too, in printable characters."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [printable_values(item) for item in value]
    if isinstance(value, dict):
        return {printable_values(key): printable_values(item) for key, item in value.items()}
    return value


def _escape(match: re.Match[str]) -> str:
    character = match[0]
    return character if character.isprintable() else repr(character)[1:-1]


class PrintableStream:
    """A text stream whose output holds no control characters but line feeds and tabs."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        self.stream.write(printable_lines(text))
        return len(text)

    def writelines(self, lines: Any) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def printable_stream(stream: TextIO) -> TextIO:
    """Wrap a stream as a `PrintableStream`, unless it is one already."""
    return stream if isinstance(stream, PrintableStream) else cast(TextIO, PrintableStream(stream))


def underlying_stream(stream: TextIO) -> TextIO:
    """The stream beneath a `PrintableStream`, for a library that moves the cursor."""
    return stream.stream if isinstance(stream, PrintableStream) else stream
