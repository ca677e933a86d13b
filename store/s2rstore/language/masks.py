"""From nodes to boolean masks over dense columns: the application's back end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.columns import InstanceColumns, RunColumns
from s2rstore.language import angles, fields
from s2rstore.language.context import Vocabulary, expand
from s2rstore.language.nodes import (
    And,
    Around,
    Bend,
    Between,
    Box,
    Compare,
    Everything,
    Extreme,
    Field,
    Ids,
    Minus,
    Named,
    Near,
    Node,
    Not,
    Nothing,
    Or,
)

Mask = NDArray[np.bool_]
_STRAIGHT_BELOW = 10.0
_OPERATORS = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "=": np.equal,
}


@dataclass(frozen=True, slots=True)
class MaskContext:
    """Columns to evaluate on: `run_columns` gives those of a named run.

    `trajectories` are those in view; None means all of them.
    """

    instances: InstanceColumns
    run: str
    run_columns: Callable[[str], RunColumns]
    words: Vocabulary
    trajectories: tuple[str, ...] | None = None


def mask(node: Node, context: MaskContext) -> Mask:
    """The selected instances, shape (N,). Raises ExpressionError for unknown names."""
    base = base_population(context)
    return _evaluate(expand(node, context.words), context, base) & base


def base_population(context: MaskContext, run: str | None = None) -> Mask:
    """The valid instances of the run in the trajectories in view."""
    valid = context.run_columns(run or context.run).valid
    if context.trajectories is None:
        return valid
    names = context.instances.trajectory_names
    codes = [names.index(name) for name in context.trajectories if name in names]
    return valid & np.isin(context.instances.trajectory, codes)


def _evaluate(node: Node, context: MaskContext, base: Mask) -> Mask:
    if isinstance(node, Not):
        return ~_evaluate(node.inner, context, base)
    if isinstance(node, And):
        return _evaluate(node.left, context, base) & _evaluate(node.right, context, base)
    if isinstance(node, Minus):
        return _evaluate(node.left, context, base) & ~_evaluate(node.right, context, base)
    if isinstance(node, Or):
        return _evaluate(node.left, context, base) | _evaluate(node.right, context, base)
    with np.errstate(invalid="ignore"):
        return _leaf(node, context, base)


def _leaf(node: Node, context: MaskContext, base: Mask) -> Mask:
    match node:
        case Everything():
            return base
        case Nothing():
            return np.zeros_like(base)
        case Ids(ranges):
            chosen = np.zeros_like(base)
            for low, high in ranges:
                chosen[max(0, low) : max(0, high + 1)] = True
            return chosen
        case Compare(field, operator, value):
            return _compare(_values(field, context), operator, value * _scale(field))
        case Between():
            return _between(node, context)
        case Around():
            return _around(node, context)
        case Named():
            return _named(node, context)
        case Extreme():
            return _extreme(node, context)
        case Box(x, y, (x0, y0, x1, y1)):
            u, v = _values(x, context), _values(y, context)
            return np.asarray((u >= x0) & (u <= x1) & (v >= y0) & (v <= y1))
        case Near(x, y, (cx, cy), radius):
            dx, dy = _values(x, context) - cx, _values(y, context) - cy
            return np.asarray(dx * dx + dy * dy <= radius * radius)
        case Bend(straight):
            bend = np.abs(context.instances.curvature)
            return np.asarray(bend < _STRAIGHT_BELOW if straight else bend >= _STRAIGHT_BELOW)
        case _:
            raise TypeError(f"{type(node).__name__} is no leaf")


def _compare(values: NDArray[np.float64], operator: str, limit: float) -> Mask:
    if operator == "!=":
        return np.asarray((values != limit) & ~np.isnan(values))
    return np.asarray(_OPERATORS[operator](values, limit))


def _between(node: Between, context: MaskContext) -> Mask:
    values = _values(node.field, context)
    if not fields.NUMERIC[node.field.name].angle:
        scale = _scale(node.field)
        return np.asarray((values >= node.low * scale) & (values <= node.high * scale))
    ends = angles.span(node.low, node.high)
    if ends is None:
        return ~np.isnan(values)
    above, below = values >= ends[0], values <= ends[1]
    return np.asarray(above & below if ends[0] <= ends[1] else above | below)


def _around(node: Around, context: MaskContext) -> Mask:
    values = _values(node.field, context)
    if not fields.NUMERIC[node.field.name].angle:
        scale = _scale(node.field)
        return np.asarray(np.abs(values - node.centre * scale) <= node.tolerance * scale)
    off = np.abs(values - angles.wrapped(node.centre))
    off = np.minimum(off, angles.TURN - off)
    return np.asarray(off <= math.radians(node.tolerance) + angles.TOLERANCE)


def _named(node: Named, context: MaskContext) -> Mask:
    text = fields.TEXT[node.field.name]
    names = {
        "rooms": context.instances.room_names,
        "trajectories": context.instances.trajectory_names,
        "splits": context.words.splits,
    }[text.vocabulary]
    codes = _column(text.path, node.field.run, context)
    return np.asarray(codes == names.index(node.value))


def _extreme(node: Extreme, context: MaskContext) -> Mask:
    base = base_population(context, node.field.run)
    chosen = np.zeros_like(base)
    total = int(base.sum())
    count = math.ceil(node.amount * total / 100) if node.percent else int(node.amount)
    values = _values(node.field, context)
    rows = np.flatnonzero(base & ~np.isnan(values))
    if not count or not rows.size:
        return chosen
    keys = values[rows] if node.which == "best" else -values[rows]
    if count < rows.size:
        limit = np.partition(keys, count - 1)[count - 1]
        below = rows[keys < limit]
        ties = rows[keys == limit][: count - below.size]
        chosen[below] = chosen[ties] = True
    else:
        chosen[rows] = True
    return chosen


def _scale(field: Field) -> float:
    return fields.NUMERIC[field.name].scale


def _values(field: Field, context: MaskContext) -> NDArray[np.float64]:
    column = _column(fields.NUMERIC[field.name].path, field.run, context)
    if field.name.endswith(".rank"):
        return np.where(column > 0, column, np.nan)
    if field.name == "seq":
        return np.where(column >= 0, column, np.nan)
    return np.asarray(column, dtype=np.float64)


def _column(path: str, run: str | None, context: MaskContext) -> NDArray[Any]:
    if path == "iid":
        return np.arange(len(context.instances), dtype=np.float64)
    owner: Any = context.run_columns(run or context.run)
    for part in path.split("."):
        owner = context.instances if part == "instances" else getattr(owner, part)
    return np.asarray(owner)
