"""The functions of the language: adding one is a builder and a line of the registry here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

from s2rstore.errors import ExpressionError, unknown
from s2rstore.language import fields
from s2rstore.language.lasso import MAX_CORNERS
from s2rstore.language.syntax_tree import (
    Box,
    Extreme,
    Field,
    Ids,
    LabelGain,
    Lasso,
    Like,
    Near,
    Node,
    Operator,
)
from s2rstore.records import Side

MAX_NEIGHBOURS = 100_000
_LABEL_GAIN, _GAIN_USAGE = "harm.label", 'harm.label("chair") > 0.2'


class Head:
    """A dotted name with its run and its column."""

    def __init__(self, name: str, column: int, run: str | None = None) -> None:
        self.name, self.column, self.run = name, column, run


class Call(Head):
    """A name with arguments, each a pair of its kind and its content."""

    def __init__(
        self, name: str, column: int, arguments: list[Any], run: str | None = None
    ) -> None:
        super().__init__(name, column, run)
        self.arguments = arguments


def apply(head: Call) -> Node:
    """The node of a function call. Raises ExpressionError."""
    arguments = head.arguments
    prefix, dot, last = head.name.rpartition(".")
    if head.name == _LABEL_GAIN:
        raise ExpressionError(head.column, f"{head.name} needs a comparison", [_GAIN_USAGE])
    if head.name in _PLAIN and not (head.name == "ids" and head.run):
        return _PLAIN[head.name](head, arguments)
    if last == "like" and prefix in ("", "sim", "real"):
        return _like(head, arguments, "sim" if prefix == "sim" else "real")
    if f"{head.name}." in fields.PLANES:
        return _box(head, arguments, fields.PLANES[f"{head.name}."])
    if prefix + dot in fields.PLANES and last in _SHAPES:
        return _SHAPES[last](head, arguments, fields.PLANES[prefix + dot])
    raise unknown(head.column, "function", head.name, fields.FUNCTIONS)


def compared(call: Call, operator: Operator, value: float) -> Node:
    """The node of a function whose number is compared with a value. Raises ExpressionError."""
    if call.name != _LABEL_GAIN:
        apply(call)  # its own mistakes come first
        raise ExpressionError(call.column, f"{call.name} is no number to compare", [_GAIN_USAGE])
    if [kind for kind, _ in call.arguments] != ["text"]:
        raise ExpressionError(call.column, f"{call.name} takes a quoted label", [_GAIN_USAGE])
    return LabelGain(call.arguments[0][1], operator, value, call.run, call.column)


def numeric(head: Head) -> Field:
    """A field of numbers. Raises ExpressionError with the nearest known ones."""
    if head.name not in fields.NUMERIC:
        if field := fields.meant(head.name):
            raise unknown(head.column, "number field", head.name, [field])
        raise unknown(head.column, "number field", head.name, list(fields.NUMERIC))
    return Field(head.name, head.run)


def _extreme(head: Head, arguments: list[Any]) -> Node:
    usage = [f"{head.name}(20%, real.error)", f"{head.name}(25, gap)"]
    kinds = [kind for kind, _ in arguments]
    if kinds[:1] not in (["percent"], ["number"]) or kinds[1:] not in ([], ["field"]):
        raise ExpressionError(head.column, f"{head.name} takes a share and a field", usage)
    percent, amount = kinds[0] == "percent", arguments[0][1][0]
    if amount < 0 or (percent and amount > 100) or (not percent and amount != int(amount)):
        raise ExpressionError(head.column, "the share is 0% .. 100% or a whole number", usage)
    field = numeric(arguments[1][1]) if len(arguments) == 2 else Field("real.error")
    field = Field(field.name, field.run or head.run)
    return Extreme("worst" if head.name == "worst" else "best", amount, percent, field)


def _ids(head: Head, arguments: list[Any]) -> Node:
    ranges = []
    for kind, content in arguments:
        ends = (content[0], content[0]) if kind == "number" else content
        if kind not in ("number", "span") or any(end != int(end) for end in ends):
            raise ExpressionError(head.column, "ids takes whole numbers", ["ids(3, 7..12)"])
        if ends[0] > ends[1]:
            raise ExpressionError(head.column, "the range's first end is above its second")
        ranges.append((int(ends[0]), int(ends[1])))
    return Ids(tuple(ranges))


def _like(head: Head, arguments: list[Any], side: Side) -> Node:
    usage = [f"{head.name}(123, 20)"]
    iid, count = _numbers(head, arguments, "iid, k", usage)
    if iid != int(iid) or count != int(count) or iid < 0 or not 1 <= count <= MAX_NEIGHBOURS:
        problem = f"{head.name} takes an instance and 1 .. {MAX_NEIGHBOURS} neighbours"
        raise ExpressionError(head.column, problem, usage)
    return Like(side, int(iid), int(count), head.run, head.column)


def _box(head: Head, arguments: list[Any], plane: tuple[str, str]) -> Node:
    x0, y0, x1, y1 = _numbers(head, arguments, "x0, y0, x1, y1")
    corners = min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)
    return Box(Field(plane[0], head.run), Field(plane[1], head.run), corners)


def _near(head: Head, arguments: list[Any], plane: tuple[str, str]) -> Node:
    x, y, radius = _numbers(head, arguments, "x, y, radius")
    if radius < 0:
        raise ExpressionError(head.column, "the radius is below 0")
    return Near(Field(plane[0], head.run), Field(plane[1], head.run), (x, y), radius)


def _lasso(head: Head, arguments: list[Any], plane: tuple[str, str]) -> Node:
    usage = "x0, y0, x1, y1, x2, y2, ..."
    numbers = _numbers(head, arguments, usage)
    if len(numbers) % 2:
        raise ExpressionError(head.column, f"{head.name} takes {usage}; the last corner has no y")
    if not 3 <= len(numbers) // 2 <= MAX_CORNERS:
        problem = f"{head.name} takes {usage}: 3 .. {MAX_CORNERS} corners"
        raise ExpressionError(head.column, f"{problem}, not {len(numbers) // 2}")
    corners = tuple(zip(numbers[::2], numbers[1::2], strict=True))
    return Lasso(Field(plane[0], head.run), Field(plane[1], head.run), corners)


def _numbers(
    head: Head, arguments: list[Any], usage: str, examples: Sequence[str] = ()
) -> list[float]:
    """The arguments, which must be numbers, one for each part of `usage` unless it ends in ..."""
    has_all = usage.endswith("...") or len(arguments) == usage.count(",") + 1
    if not has_all or any(kind != "number" for kind, _ in arguments):
        raise ExpressionError(head.column, f"{head.name} takes {usage}", examples)
    return [cast(float, value) for _, (value, _) in arguments]


_PLAIN: dict[str, Callable[[Head, list[Any]], Node]] = {
    "worst": _extreme,
    "best": _extreme,
    "ids": _ids,
}
_SHAPES: dict[str, Callable[[Head, list[Any], tuple[str, str]], Node]] = {
    "box": _box,
    "near": _near,
    "lasso": _lasso,
}
