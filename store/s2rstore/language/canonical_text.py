"""Write syntax trees as canonical text; `parse(to_text(node)) == node`."""

from __future__ import annotations

import re
from dataclasses import replace

from s2rstore.language import fields
from s2rstore.language import syntax_tree as tree

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*\Z")
_OR, _AND, _NOT, _LEAF = range(4)
_SIGNS = {tree.Or: "|", tree.And: "&", tree.Minus: "-"}


def to_text(node: tree.Node) -> str:
    """The shortest unambiguous form of an expression."""
    return _with_precedence(node)[0]


def located(node: tree.Node) -> tree.Node:
    """The same tree with the columns that its names have in the canonical text, as if parsed."""
    text, end = to_text(node), 0
    placed: list[tree.Node] = []
    for leaf in tree.leaves(node):
        start = text.index(_leaf(leaf), end)
        end = start + len(_leaf(leaf))
        if isinstance(leaf, tree.Named):
            leaf = replace(leaf, column=start + len(_field(leaf.field)) + 2)
        elif isinstance(leaf, tree.Like | tree.LabelGain | tree.Saved):
            leaf = replace(leaf, column=start + 1)
        placed.append(leaf)
    return tree.with_leaves(node, iter(placed))


def _with_precedence(node: tree.Node) -> tuple[str, int]:
    """The text, and the precedence of its operator."""
    first, links = tree.chain(node)
    if isinstance(first, tree.Not):
        text, level = f"!{_operand(first.inner, _NOT)}", _NOT
    else:
        text, level = _leaf(first), _LEAF
    parts: list[str] = []
    for link in links:
        precedence = _OR if isinstance(link, tree.Or) else _AND
        if level < precedence:
            parts = ["(", *parts, text, ")"]
        else:
            parts.append(text)
        level = precedence
        text = f" {_SIGNS[type(link)]} {_operand(link.right, precedence + 1)}"
    return "".join([*parts, text]), level


def _operand(node: tree.Node, least: int) -> str:
    text, precedence = _with_precedence(node)
    return text if precedence >= least else f"({text})"


def _leaf(node: tree.Node) -> str:
    match node:
        case tree.Everything():
            return "all"
        case tree.Nothing():
            return "none"
        case tree.Ids(ranges):
            return f"ids({', '.join(str(a) if a == b else f'{a}..{b}' for a, b in ranges)})"
        case tree.Compare(field, operator, value):
            return f"{_field(field)} {operator} {_number(value)}"
        case tree.Between(field, low, high):
            return f"{_field(field)}:{_number(low)}..{_number(high)}"
        case tree.Around(field, centre, tolerance):
            return f"{_field(field)}:{_number(centre)}+-{_number(tolerance)}"
        case tree.Named(field, value):
            return f"{_field(field)}:{quoted(value)}"
        case tree.Extreme(which, 15, True, tree.Field("real.error", None)):
            return f"{which}15"
        case tree.Extreme(which, amount, percent, field):
            return f"{which}({_number(amount)}{'%' if percent else ''}, {_field(field)})"
        case tree.Box(x, _, corners):
            return _call(x, "box", corners)
        case tree.Near(x, _, centre, radius):
            return _call(x, "near", (*centre, radius))
        case tree.Lasso(x, _, corners):
            return _call(x, "lasso", tuple(value for corner in corners for value in corner))
        case tree.Like(side, iid, count, run):
            return f"{_run(run)}{'sim.' if side == 'sim' else ''}like({iid}, {count})"
        case tree.LabelGain(label, operator, value, run):
            return f"{_run(run)}harm.label({string(label)}) {operator} {_number(value)}"
        case tree.Bend(straight):
            return "straight" if straight else "curved"
        case tree.Paired(run):
            return f"{_run(run)}paired"
        case tree.Training(trained, run):
            return f"{_run(run)}{'trained' if trained else 'new'}"
        case tree.Saved(name):
            return f"@{quoted(name)}"
        case _:
            raise TypeError(f"{type(node).__name__} is not a leaf")


def _call(field: tree.Field, name: str, numbers: tuple[float, ...]) -> str:
    prefix = next(p for p, plane in fields.PLANES.items() if plane[0] == field.name)
    short = name == "box" and prefix.startswith("umap.")
    function = prefix.rstrip(".") if short else f"{prefix}{name}"
    listed = ", ".join(_number(value) for value in numbers)
    return f"{_run(field.run)}{function}({listed})"


def _run(run: str | None) -> str:
    return f"run({string(run)})." if run is not None else ""


def _field(field: tree.Field) -> str:
    return f"{_run(field.run)}{field.name}"


def quoted(name: str) -> str:
    """A name in the form of an expression, quoted where necessary."""
    return name if _PLAIN.match(name) else string(name)


def string(name: str) -> str:
    """A name in quotation marks."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
