"""From nodes to boolean masks over dense columns: the application's back end."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.columns import InstanceColumns, RunColumns, population
from s2rstore.extremes import extremes
from s2rstore.language import angles, fields, lasso
from s2rstore.language.context import Neighbours, Vocabulary, expand, resolved, used_fields
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
    Lasso,
    Like,
    Minus,
    Named,
    Near,
    Node,
    Not,
    Nothing,
    chain,
)
from s2rstore.recent import Recent

Mask = NDArray[np.bool_]
Values = NDArray[np.float64]
_STRAIGHT_BELOW = 10.0
_CURVATURE = Field("curvature")
_BLOCK = 32_768
_KEPT_BYTES = 64 * 2**20
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

    `trajectories` are those in view; None means all of them. `neighbours` finds what `like` means.
    `evaluated` keeps the masks of leaves: share it between contexts of the same columns.
    """

    instances: InstanceColumns
    run: str
    run_columns: Callable[[str], RunColumns]
    words: Vocabulary
    trajectories: tuple[str, ...] | None = None
    neighbours: Neighbours | None = None
    evaluated: Recent = field(default_factory=lambda: Recent(_KEPT_BYTES))


def mask(node: Node, context: MaskContext) -> Mask:
    """The selected instances, shape (N,). Raises ExpressionError for unknown names."""
    base = base_population(context)
    return _evaluate(expand(node, context.words), context, base) & base


def base_population(context: MaskContext, run: str | None = None) -> Mask:
    """The valid instances of the run in the trajectories in view; not to be changed."""
    name, view = run or context.run, context.trajectories
    valid = context.run_columns(name).valid
    if view is None:
        return valid
    return _kept(context, ("base", name, view), lambda: population(valid, context.instances, view))


def _kept(context: MaskContext, key: Hashable, make: Callable[[], Mask]) -> Mask:
    """A mask that is made once."""

    def made() -> Mask:
        fresh = make()
        fresh.flags.writeable = False
        return fresh

    return context.evaluated.get(key, made)


def _evaluate(node: Node, context: MaskContext, base: Mask) -> Mask:
    first, links = chain(node)
    found = _operand(first, context, base)
    for link in links:
        right = _evaluate(link.right, context, base)
        if isinstance(link, And):
            found = found & right
        elif isinstance(link, Minus):
            found = found & ~right
        else:
            found = found | right
    return found


def _operand(node: Node, context: MaskContext, base: Mask) -> Mask:
    if isinstance(node, Not):
        return ~_evaluate(node.inner, context, base)
    if isinstance(node, Everything):
        return base
    if isinstance(node, Nothing):
        return np.zeros_like(base)
    return _kept(context, _key(node, context), lambda: _leaf(node, context))


def _key(node: Node, context: MaskContext) -> Hashable:
    """All that a leaf's mask depends on."""
    if isinstance(node, Extreme | Like):
        return node, context.run, context.trajectories
    of_a_run = not all(fields.is_truth(used.name) for used in used_fields(node))
    return node, context.run if of_a_run else None


def _leaf(node: Node, context: MaskContext) -> Mask:
    with np.errstate(over="ignore", invalid="ignore"):
        match node:
            case Ids(ranges):
                return _ids(ranges, len(context.instances))
            case Compare(field, operator, value):
                limit = value * _scale(field)
                return _blockwise(lambda v: _compare(v, operator, limit), context, field)
            case Between():
                return _between(node, context)
            case Around():
                return _around(node, context)
            case Named():
                return _named(node, context)
            case Extreme():
                return _extreme(node, context)
            case Box():
                return _box(node, context)
            case Near():
                return _near(node, context)
            case Lasso(x, y, corners):
                return lasso.inside(_bands(x, y, context), corners, len(context.instances))
            case Like():
                return _like(node, context)
            case Bend(straight):
                compare = np.less if straight else np.greater_equal
                return _blockwise(
                    lambda v: compare(np.abs(v), _STRAIGHT_BELOW), context, _CURVATURE
                )
            case _:
                raise TypeError(f"{type(node).__name__} is no leaf")


def _blockwise(condition: Callable[..., Mask], context: MaskContext, *used: Field) -> Mask:
    """A condition over fields, evaluated in blocks that stay in the processor's cache."""
    columns = [_column(fields.NUMERIC[field.name].path, field.run, context) for field in used]
    found = np.empty(len(context.instances), dtype=np.bool_)
    for start in range(0, found.size, _BLOCK):
        block = slice(start, start + _BLOCK)
        parts = (_known(field, column[block]) for field, column in zip(used, columns, strict=True))
        found[block] = condition(*parts)
    return found


def _ids(ranges: tuple[tuple[int, int], ...], n: int) -> Mask:
    chosen = np.zeros(n, dtype=np.bool_)
    for low, high in ranges:
        chosen[max(0, low) : max(0, high + 1)] = True
    return chosen


def _compare(values: Values, operator: str, limit: float) -> Mask:
    if operator == "!=":
        return np.asarray((values != limit) & ~np.isnan(values))
    return np.asarray(_OPERATORS[operator](values, limit))


def _between(node: Between, context: MaskContext) -> Mask:
    if not fields.NUMERIC[node.field.name].angle:
        low, high = node.low * _scale(node.field), node.high * _scale(node.field)
        return _blockwise(lambda v: (v >= low) & (v <= high), context, node.field)
    ends = angles.span(node.low, node.high)
    if ends is None:
        return _blockwise(lambda v: ~np.isnan(v), context, node.field)
    first, last = ends
    if first <= last:
        return _blockwise(lambda v: (v >= first) & (v <= last), context, node.field)
    return _blockwise(lambda v: (v >= first) | (v <= last), context, node.field)


def _around(node: Around, context: MaskContext) -> Mask:
    if not fields.NUMERIC[node.field.name].angle:
        scale = _scale(node.field)
        centre, tolerance = node.centre * scale, node.tolerance * scale
        return _blockwise(lambda v: np.abs(v - centre) <= tolerance, context, node.field)
    middle = angles.wrapped(node.centre)
    limit = math.radians(node.tolerance) + angles.TOLERANCE

    def near(block: Values) -> Mask:
        off = np.abs(block - middle)
        return np.asarray(np.minimum(off, angles.TURN - off) <= limit)

    return _blockwise(near, context, node.field)


def _box(node: Box, context: MaskContext) -> Mask:
    x0, y0, x1, y1 = node.corners
    return _blockwise(
        lambda u, v: (u >= x0) & (u <= x1) & (v >= y0) & (v <= y1), context, node.x, node.y
    )


def _near(node: Near, context: MaskContext) -> Mask:
    cx, cy = node.centre
    limit = node.radius * node.radius

    def near(u: Values, v: Values) -> Mask:
        dx, dy = u - cx, v - cy
        return np.asarray(dx * dx + dy * dy <= limit)

    return _blockwise(near, context, node.x, node.y)


def _bands(x: Field, y: Field, context: MaskContext) -> lasso.Bands:
    run = None if fields.is_truth(x.name) else x.run or context.run
    return context.evaluated.get(
        ("bands", x.name, y.name, run),
        lambda: lasso.bands(_values(x, context), _values(y, context)),
    )


def _like(node: Like, context: MaskContext) -> Mask:
    chosen = np.zeros(len(context.instances), dtype=np.bool_)
    chosen[resolved(node, context.run, context.trajectories, context.neighbours)] = True
    return chosen


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
    total = np.count_nonzero(base)
    count = math.ceil(node.amount * total / 100) if node.percent else int(node.amount)
    return extremes(_values(node.field, context), base, count, node.which == "worst")


def _scale(field: Field) -> float:
    return fields.NUMERIC[field.name].scale


def _values(field: Field, context: MaskContext) -> Values:
    return _known(field, _column(fields.NUMERIC[field.name].path, field.run, context))


def _known(field: Field, column: NDArray[Any]) -> Values:
    """A field's column or some of it, NaN for NULL."""
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
