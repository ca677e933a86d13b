"""From nodes to canonical text; `parse(to_text(node)) == node`."""

from __future__ import annotations

import re

from s2rstore.language import fields
from s2rstore.language.syntax_tree import (And, Around, Bend, Between, Box, Compare, Everything, Extreme, Field, Ids, Lasso, Like, Minus, Named, Near, Node, Not, Nothing, Or, Saved, chain,)

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*\Z")
_OR, _AND, _NOT, _LEAF = range(4)
_SIGNS = {Or: "|", And: "&", Minus: "-"}


def to_text(node: Node) -> str:
    """The expression in its shortest unambiguous form."""
    return _written(node)[0]


def _written(node: Node) -> tuple[str, int]:
    """The text, and how tightly its operator binds."""
    first, links = chain(node)
    text, level = _operand(first)
    if not links:
        return text, level
    parts: list[str] = []
    for link in links:
        own = _OR if isinstance(link, Or) else _AND
        if level < own:
            parts = ["(", *parts, text, ")"]
        else:
            parts.append(text)
        text, level = f" {_SIGNS[type(link)]} {_inside(link.right, own + 1)}", own
    return "".join([*parts, text]), level


def _operand(node: Node) -> tuple[str, int]:
    if isinstance(node, Not):
        return f"!{_inside(node.inner, _NOT)}", _NOT
    return _leaf(node), _LEAF


def _inside(node: Node, level: int) -> str:
    text, own = _written(node)
    return text if own >= level else f"({text})"


def _leaf(node: Node) -> str:
    match node:
        case Everything():
            return "all"
        case Nothing():
            return "none"
        case Ids(ranges):
            return f"ids({', '.join(str(a) if a == b else f'{a}..{b}' for a, b in ranges)})"
        case Compare(field, operator, value):
            return f"{_field(field)} {operator} {_number(value)}"
        case Between(field, low, high):
            return f"{_field(field)}:{_number(low)}..{_number(high)}"
        case Around(field, centre, tolerance):
            return f"{_field(field)}:{_number(centre)}+-{_number(tolerance)}"
        case Named(field, value):
            return f"{_field(field)}:{quoted(value)}"
        case Extreme():
            return _extreme(node)
        case Box(x, _, corners):
            return _call(x, "box", corners)
        case Near(x, _, centre, radius):
            return _call(x, "near", (*centre, radius))
        case Lasso(x, _, corners):
            return _call(x, "lasso", tuple(value for corner in corners for value in corner))
        case Like(side, iid, count, run):
            return f"{_run(run)}{'sim.' if side == 'sim' else ''}like({iid}, {count})"
        case Bend(straight):
            return "straight" if straight else "curved"
        case Saved(name):
            return f"@{quoted(name)}"
        case _:
            raise TypeError(f"{type(node).__name__} is no leaf")


def _extreme(node: Extreme) -> str:
    if node.amount == 15 and node.percent and node.field == Field("real.error"):
        return f"{node.which}15"
    share = f"{_number(node.amount)}{'%' if node.percent else ''}"
    return f"{node.which}({share}, {_field(node.field)})"


def _call(field: Field, name: str, numbers: tuple[float, ...]) -> str:
    prefix = next(p for p, plane in fields.PLANES.items() if plane[0] == field.name)
    short = name == "box" and prefix.startswith("umap.")
    function = prefix.rstrip(".") if short else f"{prefix}{name}"
    listed = ", ".join(_number(value) for value in numbers)
    return f"{_run(field.run)}{function}({listed})"


def _run(run: str | None) -> str:
    return f"run({string(run)})." if run is not None else ""


def _field(field: Field) -> str:
    return f"{_run(field.run)}{field.name}"


def quoted(name: str) -> str:
    """A name as it can stand in an expression."""
    return name if _PLAIN.match(name) else string(name)


def string(name: str) -> str:
    """A name in quotation marks."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
