"""Labels of keys: Textual's names turned into what a keyboard shows."""

from __future__ import annotations

import unicodedata
from contextlib import suppress

from textual.keys import KEY_NAME_REPLACEMENTS

_UNICODE = {short: long for long, short in KEY_NAME_REPLACEMENTS.items()}
_WORDS = {"pagedown": "page down", "pageup": "page up"}


def key_label(name: str) -> str:
    """The ASCII label of a Textual key name: `=` for `equals_sign`, `shift+left` unchanged."""
    *held, last = name.split("+") if len(name) > 1 else [name]
    long, word = _UNICODE.get(last, last).upper(), _WORDS.get(last, last)
    for spelled in (long.replace("_", " "), long.replace("_", "-")):
        with suppress(KeyError):
            char = unicodedata.lookup(spelled)
            word = char if char.isascii() and char.isprintable() and char != " " else word
    return "+".join([*held, word])
