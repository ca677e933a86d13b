"""The functions of the language: adding one is a builder and a line of the registry here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from s2rstore.errors import ExpressionError, unknown
from s2rstore.language import fields
from s2rstore.language.lasso import MAX_CORNERS
from s2rstore.language.syntax_tree import Box, Extreme, Field, Ids, Lasso, Like, Near, Node
from s2rstore.records import Side

MAX_NEIGHBOURS = 100_000


class Head:
    """A dotted name with its run and its column."""

    def __init__(self, name: str, column: int, run: str | None = None) -> None:
        self.name, self.column, self.run = name, column, run


class Call(Head):
    """A name with arguments, each a pair of its kind and its content."""

    def __init__(self, name: str, column: int, arguments: list[Any]) -> None:
        super().__init__(name, column)
        self.arguments = arguments


def apply(head: Head, arguments: list[Any]) -> Node:
    """The node of a function call. Raises ExpressionError."""
    prefix, dot, last = head.name.rpartition(".")
    if head.name in _PLAIN and not (head.name == "ids" and head.run):
        return _PLAIN[head.name](head, arguments)
    if last == "like" and prefix in ("", "sim", "real"):
        return _like(head, arguments, "sim" if prefix == "sim" else "real")
    if f"{head.name}." in fields.PLANES:
        return _box(head, arguments, fields.PLANES[f"{head.name}."])
    if prefix + dot in fields.PLANES and last in _SHAPES:
        return _SHAPES[last](head, arguments, fields.PLANES[prefix + dot])
    raise unknown(head.column, "function", head.name, fields.FUNCTIONS)


def has_kind(argument: Any, kind: str) -> bool:
    return bool(argument[0] == kind)


def numeric(head: Head) -> Field:
    """A field of numbers. Raises ExpressionError with the nearest known ones."""
    if head.name not in fields.NUMERIC:
        raise unknown(head.column, "number field", head.name, list(fields.NUMERIC))
    return Field(head.name, head.run)


def _extreme(head: Head, arguments: list[Any]) -> Node:
    usage = [f"{head.name}(20%, real.error)", f"{head.name}(25, gap)"]
    if not 1 <= len(arguments) <= 2 or arguments[0][0] not in ("percent", "number"):
        raise ExpressionError(head.column, f"{head.name} takes a share and a field", usage)
    percent = has_kind(arguments[0], "percent")
    amount = arguments[0][1][0]
    if amount < 0 or (percent and amount > 100) or (not percent and amount != int(amount)):
        raise ExpressionError(head.column, "the share is 0% .. 100% or a whole number", usage)
    field = Field("real.error", head.run)
    if len(arguments) == 2:
        if not has_kind(arguments[1], "field"):
            raise ExpressionError(head.column, f"{head.name} takes a share and a field", usage)
        field = numeric(arguments[1][1])
        field = Field(field.name, field.run or head.run)
    return Extreme("worst" if head.name == "worst" else "best", amount, percent, field)


def _ids(head: Head, arguments: list[Any]) -> Node:
    return Ids(tuple(_id_range(head, argument) for argument in arguments))


def _id_range(head: Head, argument: Any) -> tuple[int, int]:
    if argument[0] not in ("number", "span"):
        raise ExpressionError(head.column, "ids takes whole numbers", ["ids(3, 7..12)"])
    ends = argument[1] if has_kind(argument, "span") else (argument[1][0],) * 2
    if any(end != int(end) for end in ends):
        raise ExpressionError(head.column, "ids takes whole numbers", ["ids(3, 7..12)"])
    if ends[0] > ends[1]:
        raise ExpressionError(head.column, "the range's first end is above its second")
    return int(ends[0]), int(ends[1])


def _like(head: Head, arguments: list[Any], side: Side) -> Node:
    usage = [f"{head.name}(123, 20)"]
    if len(arguments) != 2 or not all(has_kind(argument, "number") for argument in arguments):
        raise ExpressionError(head.column, f"{head.name} takes iid, k", usage)
    iid, count = (argument[1][0] for argument in arguments)
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
    if any(not has_kind(argument, "number") for argument in arguments):
        raise ExpressionError(head.column, f"{head.name} takes {usage}")
    numbers = [argument[1][0] for argument in arguments]
    if len(numbers) % 2:
        raise ExpressionError(head.column, f"{head.name} takes {usage}; the last corner has no y")
    if not 3 <= len(numbers) // 2 <= MAX_CORNERS:
        problem = f"{head.name} takes {usage}: 3 .. {MAX_CORNERS} corners"
        raise ExpressionError(head.column, f"{problem}, not {len(numbers) // 2}")
    corners = tuple(zip(numbers[::2], numbers[1::2], strict=True))
    return Lasso(Field(plane[0], head.run), Field(plane[1], head.run), corners)


def _numbers(head: Head, arguments: list[Any], usage: str) -> list[float]:
    if len(arguments) != usage.count(",") + 1 or any(not has_kind(a, "number") for a in arguments):
        raise ExpressionError(head.column, f"{head.name} takes {usage}")
    return [cast(float, argument[1][0]) for argument in arguments]


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
