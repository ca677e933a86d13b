"""Names of keys: Textual's words for them, and what stands on a keyboard."""

from __future__ import annotations

import unicodedata
from contextlib import suppress

from textual.keys import KEY_NAME_REPLACEMENTS

_UNICODE = {short: long for long, short in KEY_NAME_REPLACEMENTS.items()}
_WORDS = {"pagedown": "page down", "pageup": "page up"}


def key_label(name: str) -> str:
    """A key of Textual's name in ASCII: `=` of `equals_sign`, `shift+left` as it is."""
    *held, last = name.split("+") if len(name) > 1 else [name]
    long, word = _UNICODE.get(last, last).upper(), _WORDS.get(last, last)
    for spelled in (long.replace("_", " "), long.replace("_", "-")):
        with suppress(KeyError):
            char = unicodedata.lookup(spelled)
            word = char if char.isascii() and char.isprintable() and char != " " else word
    return "+".join([*held, word])
