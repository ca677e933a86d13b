"""What could be typed next on the query line."""

from __future__ import annotations

import re

from s2rstore.language import fields
from s2rstore.language.canonical_text import quoted, string
from s2rstore.language.name_resolution import Vocabulary

Option = tuple[str, str]

_STRING = r'"(?:\\.|[^"\\])*"'
_TAIL = re.compile(
    r'(?P<field>[\w.]+):(?P<value>"[^"]*|[^"&|!()]*)\Z'
    r'|(?P<saved>@(?:"[^"]*|[^\s"&|!()]*))\Z'
    rf"|(?P<run>run\(\s*{_STRING}\s*\)\.)(?P<of_run>[\w.]*)\Z"
    r'|run\(\s*(?P<name>"?[^"()]*)\Z'
    r"|(?P<word>[\w.]*)\Z"
)
_WANTS_NUMBER = re.compile(r"(?:[<>=]|\.\.|\+-)\s*[-\d.]*\Z")
_WHOLE = re.compile(r"""[\w")%]\s*\Z""")
_QUOTED = re.compile(r'"(\\.|[^"\\])*"')
_WORD = re.compile(r"(?P<word>[\w.]*)\Z")
_JOINS = (("&", "and"), ("|", "or"), ("-", "without"))
_OPEN_CALL = re.compile(r"(?P<function>[\w.]+)\((?P<arguments>[^()]*)\Z")


def complete(text: str, words: Vocabulary) -> list[Option]:
    """Pairs (whole line with the completion, what it is) for the end of `text`, best first."""
    if _WANTS_NUMBER.search(_QUOTED.sub("_", text)):
        return []
    found = _TAIL.search(text)
    if found is not None and found["field"]:
        named = _completed(text, found["value"], _named(found["field"], words))
        if named or not re.search(r"\s", found["value"]) or found["value"].startswith('"'):
            return named
        found = _WORD.search(text)
    if found is None:
        return []
    groups = found.groupdict()
    if groups.get("saved"):
        saved = [(f"@{quoted(name)}", "saved") for name in words.saved]
        return _completed(text, found["saved"], saved)
    if groups.get("run"):
        return _completed(text, found["of_run"], _of_run())
    if groups.get("name") is not None:
        return _completed(text, found["name"], [(f"{string(run)}).", "run") for run in words.runs])
    word = found["word"]
    going_on = _completed(text, word, _here(text, word, words))
    return going_on or (
        [(text + sign, what) for sign, what in _joins(text)] if word in fields.WORDS else []
    )


def _completed(text: str, tail: str, options: list[Option]) -> list[Option]:
    """The options that begin as the tail does, without regard to quotes and capitals."""
    head, prefix = text[: len(text) - len(tail)], _bare(tail)
    return [
        (head + option, what)
        for option, what in options
        if _bare(option).startswith(prefix) and option != tail
    ]


def _bare(text: str) -> str:
    return text.replace('"', "").lower()


def _named(field: str, words: Vocabulary) -> list[Option]:
    known = fields.TEXT.get(field)
    return [(quoted(name), field) for name in words.of(known.vocabulary)] if known else []


def _here(text: str, word: str, words: Vocabulary) -> list[Option]:
    """Words outside of calls; inside, what the function's next argument could be.

    After a term that is complete comes what joins it to another one.
    """
    before = _QUOTED.sub('"', text[: len(text) - len(word)])
    call = _OPEN_CALL.search(_QUOTED.sub("_", text))
    if call is not None:
        takes_field = call["function"].split(".")[-1] in ("worst", "best")
        return _numbers() if takes_field and call["arguments"].count(",") == 1 else []
    if _WHOLE.search(before):
        return [] if word else _joins(before)
    return _words(words)


def _joins(before: str) -> list[Option]:
    space = "" if before[-1].isspace() else " "
    return [(f"{space}{sign} ", what) for sign, what in _JOINS]


def _words(words: Vocabulary) -> list[Option]:
    options = [(word, text) for word, text in fields.WORDS.items()]
    options += _functions() + _texts() + _numbers()
    options += [(f"run({string(run)}).", "another run") for run in words.runs]
    return options


def _of_run() -> list[Option]:
    """The fields and functions of another run."""
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
