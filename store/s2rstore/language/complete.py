"""What could be typed next on the query line."""

from __future__ import annotations

import re

from s2rstore.language import fields
from s2rstore.language.context import Vocabulary
from s2rstore.language.text import quoted, string

_TAIL = re.compile(
    r'(?P<field>[\w.]+):(?P<value>"?[^"\s&|!()]*)\Z|(?P<saved>@\w*)\Z|(?P<word>[\w.]*)\Z'
)


def complete(text: str, words: Vocabulary) -> list[tuple[str, str]]:
    """Pairs (whole line with the completion, what it is) for the end of `text`, best first."""
    found = _TAIL.search(text)
    if found is None:
        return []
    if found["field"]:
        known = fields.TEXT.get(found["field"])
        names = words.of(known.vocabulary) if known else ()
        tail, options = found["value"], [(quoted(name), found["field"]) for name in names]
    elif found["saved"]:
        tail, options = found["saved"], [(f"@{quoted(name)}", "saved") for name in words.saved]
    else:
        tail, options = found["word"], _words(words)
    head = text[: len(text) - len(tail)]
    wanted = tail.strip('"').lower()
    return [
        (head + option, what)
        for option, what in options
        if option.strip('"').lower().startswith(wanted) and option != tail
    ]


def _words(words: Vocabulary) -> list[tuple[str, str]]:
    options = [(word, text) for word, text in fields.WORDS.items()]
    options += [(f"{name}(", text) for name, text in fields.FUNCTIONS.items()]
    options += [(f"{name}:", text.description) for name, text in fields.TEXT.items()]
    for name, field in fields.NUMERIC.items():
        unit = f", {field.unit}" if field.unit else ""
        options.append((name, f"{field.description}{unit}"))
    options += [(f"run({string(run)}).", "another run") for run in words.runs]
    return options
