"""What could be typed next on the query line."""

from __future__ import annotations

import re

from s2rstore.language import fields
from s2rstore.language.context import Vocabulary
from s2rstore.language.text import quoted, string

Option = tuple[str, str]

_TAIL = re.compile(
    r'(?P<field>[\w.]+):(?P<value>"?[^"\s&|!()]*)\Z'
    r"|(?P<saved>@\w*)\Z"
    r'|(?P<run>run\(\s*"(?:\\.|[^"\\])*"\s*\)\.)(?P<of_run>[\w.]*)\Z'
    r'|run\(\s*(?P<name>"?[^"()]*)\Z'
    r"|(?P<word>[\w.]*)\Z"
)
_QUOTED = re.compile(r'"(\\.|[^"\\])*"')
_OPEN_CALL = re.compile(r"(?P<function>[\w.]+)\((?P<arguments>[^()]*)\Z")


def complete(text: str, words: Vocabulary) -> list[Option]:
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
    elif found["run"]:
        tail, options = found["of_run"], _of_run()
    elif found["name"] is not None:
        tail, options = found["name"], [(f"{string(run)}).", "run") for run in words.runs]
    else:
        tail, options = found["word"], _here(text, words)
    head = text[: len(text) - len(tail)]
    wanted = tail.strip('"').lower()
    return [
        (head + option, what)
        for option, what in options
        if option.strip('"').lower().startswith(wanted) and option != tail
    ]


def _here(text: str, words: Vocabulary) -> list[Option]:
    """Words outside of calls; inside, what the function's next argument could be."""
    call = _OPEN_CALL.search(_QUOTED.sub("_", text))
    if call is None:
        return _words(words)
    takes_field = call["function"].split(".")[-1] in ("worst", "best")
    return _numbers() if takes_field and call["arguments"].count(",") == 1 else []


def _words(words: Vocabulary) -> list[Option]:
    options = [(word, text) for word, text in fields.WORDS.items()]
    options += _functions() + _texts() + _numbers()
    options += [(f"run({string(run)}).", "another run") for run in words.runs]
    return options


def _of_run() -> list[Option]:
    """What another run can be asked."""
    words = [(word, fields.WORDS[word]) for word in ("worst15", "best15")]
    return (
        words + [option for option in _functions() if option[0] != "ids("] + _texts() + _numbers()
    )


def _functions() -> list[Option]:
    return [(f"{name}(", text) for name, text in fields.FUNCTIONS.items()]


def _texts() -> list[Option]:
    return [(f"{name}:", text.description) for name, text in fields.TEXT.items()]


def _numbers() -> list[Option]:
    return [
        (name, f"{field.description}{f', {field.unit}' if field.unit else ''}")
        for name, field in fields.NUMERIC.items()
    ]
