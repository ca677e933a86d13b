"""Texts about the language, the index and the views that agents read, from their registries."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from importlib import resources


def language() -> str:
    """Words, functions and fields of the selection language."""
    from s2rstore.language import fields

    lines = [
        "# Selection language", "",
        "`!a` complement, `a & b` intersection, `a - b` difference, `a | b` union; "
        "`field:low..high`, `field:value+-width`, comparisons with `<`, `<=`, `>`, `>=`; "
        '`room:"west corridor"`; '
        '`run("other").` before a field uses another run. A missing value satisfies no comparison. '
        "Angles are degrees, lengths metres.", "",
    ]  # fmt: skip
    for title, part in (("Words", fields.WORDS), ("Functions", fields.FUNCTIONS)):
        lines += [f"## {title}", "", *(f"- `{name}`: {text}" for name, text in part.items()), ""]
    lines += ["## Fields", ""]
    lines += [f"- `{name}`: {text}" for name, text in _fields()]
    return "\n".join(lines)


def _fields() -> Iterator[tuple[str, str]]:
    from s2rstore.language import fields

    for name, field in fields.NUMERIC.items():
        unit = f" ({field.unit})" if field.unit else ""
        yield name, f"{field.description}{unit}; in SQL `{field.column}` of `pair`"
    for name, named in fields.TEXT.items():
        yield name, named.description


def schema() -> str:
    """Tables and columns of the index."""
    lines = ["# Index schema", "", "Angles are radians and lengths metres.", ""]
    for name, comment, columns in _tables():
        lines += [f"## {name}", "", comment, ""]
        lines += [f"- `{column}`: {text}" for column, text in columns.items()] + [""]
    return "\n".join(lines)


def _tables() -> Iterator[tuple[str, str, dict[str, str]]]:
    from s2rstore.index import pair_view, schema

    for table in schema.TABLES:
        columns = {column.name: f"{column.comment} ({column.type})" for column in table.columns}
        yield table.name, table.comment, columns
    yield (
        "pair",
        "one row per run and instance: ground truth and both sides (a view)",
        dict(pair_view.column_comments()),
    )


def views() -> str:
    """Views whose numbers and figures the tools give."""
    from s2rtui.charts.registry import STORED

    known = {view.name: view.description for view in STORED.values()}
    return "\n".join(["# Views", "", *(f"- `{name}`: {text}" for name, text in known.items())])


def glossary() -> str:
    """The terms of the project, as the site explains them, without its links."""
    text = (resources.files("s2rtui") / "glossary.md").read_text(encoding="utf-8")
    return re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)


def _terms() -> Iterator[tuple[str, str]]:
    for entry in glossary().split("\n\n"):
        if found := re.match(r"\*\*(.+?)\*\*(.*)", entry, re.DOTALL):
            yield found[1], " ".join(found[2].strip(" \n·").split())


RESOURCES: dict[str, tuple[str, Callable[[], str]]] = {
    "language": ("words, functions and fields of the selection language", language),
    "glossary": ("terms of the project, such as gap and base population", glossary),
    "schema": ("tables and columns of the index, for the tool sql", schema),
    "views": ("views for the tools view and figure", views),
}
"""Description and text of each resource `s2r://NAME`."""


def explain(topic: str) -> str:
    """The lines about a word, function, field, table, column, view or term; empty without any."""
    from s2rstore.language import fields
    from s2rtui.charts.registry import STORED

    wanted = topic.strip().strip("`").rstrip("()").casefold()
    found = [(f"word {name}", text) for name, text in fields.WORDS.items() if name == wanted]
    found += [(f"function {name}", text) for name, text in fields.FUNCTIONS.items()
              if name.partition("(")[0].casefold() == wanted]  # fmt: skip
    found += [(f"field {name}", text) for name, text in _fields()
              if wanted in (name.casefold(), fields.with_unit(name).casefold())]  # fmt: skip
    for table, comment, columns in _tables():
        found += [(f"table {table}", comment)] if table == wanted else []
        found += [(f"column {name} of {table}", text) for name, text in columns.items()
                  if name.casefold() == wanted]  # fmt: skip
    found += [(f"view {name}", view.description) for name, view in STORED.items() if name == wanted]
    found += [(f"term {name}", text) for name, text in _terms() if name.casefold() == wanted]
    return "\n".join(f"{name}: {text}" for name, text in found)
