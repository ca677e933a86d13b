"""Completions of an expression that is being typed."""

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
_OPERATORS = (("&", "and"), ("|", "or"), ("-", "without"))
_COMPARISONS = ((">", "above"), ("<", "below"), (":", "a range 1..2, or a value 90 +- 10"))
_NUMERIC = {name for field in fields.NUMERIC for name in (field, fields.column_of(field))}
_OPEN_CALL = re.compile(r"(?P<function>[\w.]+)\((?P<arguments>[^()]*)\Z")

_FUNCTIONS = [(f"{name}(", text) for name, text in fields.FUNCTIONS.items()]
_NUMBERS = [
    (written, f"{field.description}{f', {field.unit}' if field.unit else ''}")
    for name, field in fields.NUMERIC.items()
    for written in dict.fromkeys((name, fields.column_of(name)))
]
_FIELDS = [*((f"{name}:", text.description) for name, text in fields.TEXT.items()), *_NUMBERS]


def complete(text: str, words: Vocabulary) -> list[Option]:
    """Pairs (whole line with the completion, description) for the end of `text`, best first."""
    if _WANTS_NUMBER.search(_QUOTED.sub("_", text)):
        return []
    match = _TAIL.search(text)
    if match is not None and match["field"]:
        known = fields.TEXT.get(match["field"])
        names = words.of(known.vocabulary) if known else ()
        options = [(quoted(name), match["field"]) for name in names]
        named = _completed(text, match["value"], options)
        if named or not re.search(r"\s", match["value"]) or match["value"].startswith('"'):
            return named
        match = _WORD.search(text)
    if match is None:
        return []
    groups = match.groupdict()
    if groups.get("saved"):
        saved = [(f"@{quoted(name)}", "saved") for name in words.saved]
        return _completed(text, match["saved"], saved)
    if groups.get("run"):
        options = [(word, fields.WORDS[word]) for word in fields.RUN_WORDS]
        options += [option for option in _FUNCTIONS if option[0] != "ids("]
        return _completed(text, match["of_run"], [*options, *_FIELDS])
    if groups.get("name") is not None:
        return _completed(text, match["name"], [(f"{string(run)}).", "run") for run in words.runs])
    word = match["word"]
    longer = _completed(text, word, _here(text, word, words))
    if word in _NUMERIC and _OPEN_CALL.search(text) is None:
        longer = [*((text + sign, meaning) for sign, meaning in _COMPARISONS), *longer]
    if longer or word not in fields.WORDS:
        return longer
    return [(text + sign, description) for sign, description in _operators(text)]


def _completed(text: str, tail: str, options: list[Option]) -> list[Option]:
    """The options that begin with the tail, quotes and case ignored."""
    head, prefix = text[: len(text) - len(tail)], _bare(tail)
    return [
        (head + option, description)
        for option, description in options
        if _bare(option).startswith(prefix) and option != tail
    ]


def _bare(text: str) -> str:
    return text.replace('"', "").lower()


def _here(text: str, word: str, words: Vocabulary) -> list[Option]:
    """The function's next argument inside of calls, operators after a complete term, or terms."""
    before = _QUOTED.sub('"', text[: len(text) - len(word)])
    call = _OPEN_CALL.search(_QUOTED.sub("_", text))
    if call is not None:
        takes_field = call["function"].split(".")[-1] in ("worst", "best")
        return _NUMBERS if takes_field and call["arguments"].count(",") == 1 else []
    if _WHOLE.search(before):
        return [] if word else _operators(before)
    runs = [(f"run({string(run)}).", "another run") for run in words.runs]
    return [*fields.WORDS.items(), *_FUNCTIONS, *_FIELDS, *runs]


def _operators(before: str) -> list[Option]:
    """What may follow a term: a comparison after the name of a number, or else an operator."""
    if (last := _WORD.search(before.rstrip())) is not None and last["word"] in _NUMERIC:
        return list(_COMPARISONS)
    space = "" if before[-1].isspace() else " "
    return [(f"{space}{sign} ", word) for sign, word in _OPERATORS]
