"""Evaluate syntax trees to boolean masks over dense columns: the back end of the application."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rstore.geometry.curvature import STRAIGHT_BELOW
from s2rstore.index.columns import InstanceColumns, RunColumns
from s2rstore.index.population import NEW_INSTANCES, Population
from s2rstore.language import fields, lasso
from s2rstore.language import syntax_tree as tree
from s2rstore.language.name_resolution import (
    Neighbours,
    Vocabulary,
    expand,
    similar_instances,
    used_fields,
)
from s2rstore.lru_cache import LruCache
from s2rstore.metrics.pose_metrics import population_ranks
from s2rstore.metrics.top_k import top_k

Mask = NDArray[np.bool_]
Values = NDArray[np.float64]
_CURVATURE = tree.Field("curvature")
_BLOCK = 32_768
_OPERATORS: dict[str, Callable[..., Any]] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "=": np.equal,
    "!=": lambda values, limit: (values != limit) & ~np.isnan(values),
}


@dataclass(frozen=True, slots=True)
class MaskContext:
    """Columns to evaluate on: `run_columns` returns those of a named run.

    `population` says which instances count. `neighbours` resolves `like`. `evaluated` caches the
    masks of leaves: share it between contexts of the same columns.
    """

    instances: InstanceColumns
    run: str
    run_columns: Callable[[str], RunColumns]
    words: Vocabulary
    population: Population = NEW_INSTANCES
    neighbours: Neighbours | None = None
    evaluated: LruCache = field(default_factory=lambda: LruCache(64 * 2**20))


def mask(node: tree.Node, context: MaskContext) -> Mask:
    """The selected instances of the base population, shape (N,).

    Raises ExpressionError for unknown names.
    """
    base = base_population(context)
    return _evaluate(expand(node, context.words), context, base) & base


def unpaired_mask(node: tree.Node, context: MaskContext) -> Mask:
    """The selected ones among the `unpaired` instances; see `mask`."""
    base = unpaired(context)
    return _evaluate(expand(node, context.words), context, base) & base if base.any() else base


def base_population(context: MaskContext, run: str | None = None) -> Mask:
    """The instances of the run that count, as `context.population` says; read-only."""
    name, population = run or context.run, context.population
    return _cached(
        context,
        ("base", name, population),
        lambda: population.mask(context.instances, context.run_columns(name)),
    )


def unpaired(context: MaskContext) -> Mask:
    """The instances in view that lack an image of a side, so that nothing compares them; (N,),
    read-only.
    """
    return _cached(
        context,
        ("unpaired", context.run, context.population.trajectories),
        lambda: context.population.unpaired(context.instances, context.run_columns(context.run)),
    )


def _cached(context: MaskContext, key: Hashable, compute: Callable[[], Mask]) -> Mask:
    def read_only() -> Mask:
        computed = compute()
        computed.flags.writeable = False
        return computed

    return context.evaluated.get(key, read_only)


def _evaluate(node: tree.Node, context: MaskContext, base: Mask) -> Mask:
    first, links = tree.chain(node)
    result = _operand(first, context, base)
    for link in links:
        right = _evaluate(link.right, context, base)
        if isinstance(link, tree.And):
            result = result & right
        elif isinstance(link, tree.Minus):
            result = result & ~right
        else:
            result = result | right
    return result


def _operand(node: tree.Node, context: MaskContext, base: Mask) -> Mask:
    match node:
        case tree.Not(inner):
            return ~_evaluate(inner, context, base)
        case tree.Everything():
            return base
        case tree.Nothing():
            return np.zeros_like(base)
        case _:
            return _cached(context, _key(node, context), lambda: _leaf(node, context))


def _key(node: tree.Node, context: MaskContext) -> Hashable:
    """All that a leaf's mask depends on."""
    if isinstance(node, tree.Extreme | tree.Like | tree.LabelGain | tree.Paired):
        return node, context.run, context.population
    names = [used.name for used in used_fields(node)]
    needs_run = not all(map(fields.is_truth, names))
    with_trained = context.population.with_trained if fields.RANKS.keys() & set(names) else None
    return node, context.run if needs_run else None, with_trained


def _leaf(node: tree.Node, context: MaskContext) -> Mask:
    with np.errstate(over="ignore", invalid="ignore"):
        match node:
            case tree.Ids(ranges):
                chosen = np.zeros(len(context.instances), dtype=np.bool_)
                for first, last in ranges:
                    chosen[max(0, first) : max(0, last + 1)] = True
                return chosen
            case tree.Compare(field, operator, value):
                compare, limit = _OPERATORS[operator], value * fields.NUMERIC[field.name].scale
                return _blockwise(lambda v: compare(v, limit), context, field)
            case tree.Between():
                return _between(node, context)
            case tree.Around():
                return _around(node, context)
            case tree.Named():
                return _named(node, context)
            case tree.Extreme():
                return _extreme(node, context)
            case tree.Box(x, y, (x0, y0, x1, y1)):
                return _blockwise(
                    lambda u, v: (u >= x0) & (u <= x1) & (v >= y0) & (v <= y1), context, x, y
                )
            case tree.Near(x, y, (cx, cy), radius):
                limit = radius * radius
                return _blockwise(
                    lambda u, v: np.square(u - cx) + np.square(v - cy) <= limit, context, x, y
                )
            case tree.Lasso(x, y, corners):
                return lasso.inside(_bands(x, y, context), corners, len(context.instances))
            case tree.Like():
                chosen = np.zeros(len(context.instances), dtype=np.bool_)
                chosen[
                    similar_instances(node, context.run, context.population, context.neighbours)
                ] = True
                return chosen
            case tree.LabelGain(label, operator, value, run):
                gains = context.run_columns(run or context.run).label_gains(label)
                return np.asarray(_OPERATORS[operator](gains, value))
            case tree.Paired(run):
                return context.run_columns(run or context.run).paired
            case tree.Training(trained, run):
                columns = context.run_columns(run or context.run)
                return np.asarray(columns.valid & (columns.trained == trained))
            case tree.Bend(straight):
                compare = np.less if straight else np.greater_equal
                return _blockwise(lambda v: compare(np.abs(v), STRAIGHT_BELOW), context, _CURVATURE)
            case _:
                raise TypeError(f"{type(node).__name__} is not a leaf")


def _blockwise(condition: Callable[..., Mask], context: MaskContext, *used: tree.Field) -> Mask:
    """A condition over fields, evaluated in blocks that stay in the processor's cache."""
    columns = [_field_column(field, context) for field in used]
    result = np.empty(len(context.instances), dtype=np.bool_)
    for start in range(0, result.size, _BLOCK):
        block = slice(start, start + _BLOCK)
        parts = (
            _nan_for_null(field, column[block]) for field, column in zip(used, columns, strict=True)
        )
        result[block] = condition(*parts)
    return result


def _between(node: tree.Between, context: MaskContext) -> Mask:
    field = fields.NUMERIC[node.field.name]
    if not field.angle:
        low, high = node.low * field.scale, node.high * field.scale
        return _blockwise(lambda v: (v >= low) & (v <= high), context, node.field)
    ends = angles.heading_range(node.low, node.high)
    if ends is None:
        return _blockwise(lambda v: ~np.isnan(v), context, node.field)
    first, last = ends
    joined = np.logical_and if first <= last else np.logical_or
    return _blockwise(lambda v: joined(v >= first, v <= last), context, node.field)


def _around(node: tree.Around, context: MaskContext) -> Mask:
    field = fields.NUMERIC[node.field.name]
    if not field.angle:
        centre, tolerance = node.centre * field.scale, node.tolerance * field.scale
        return _blockwise(lambda v: np.abs(v - centre) <= tolerance, context, node.field)
    middle = math.radians(angles.wrap_degrees(node.centre))
    limit = math.radians(node.tolerance) + angles.ROUNDING

    def near(block: Values) -> Mask:
        off = np.abs(block - middle)
        return np.asarray(np.minimum(off, angles.TURN - off) <= limit)

    return _blockwise(near, context, node.field)


def _bands(x: tree.Field, y: tree.Field, context: MaskContext) -> lasso.Bands:
    run = None if fields.is_truth(x.name) else x.run or context.run
    return context.evaluated.get(
        ("bands", x.name, y.name, run),
        lambda: lasso.bands(field_values(x, context), field_values(y, context)),
    )


def _named(node: tree.Named, context: MaskContext) -> Mask:
    text = fields.TEXT[node.field.name]
    truth = context.instances
    if node.field.name == "has":
        return truth.imaged(node.value)
    if node.field.name == "label":
        return truth.labelled(node.value)
    if node.field.name == "health":
        return truth.faulty(node.value)
    own = {"rooms": truth.room_names, "trajectories": truth.trajectory_names}
    names = own.get(text.vocabulary, context.words.splits)
    codes = _column(text.path, node.field.run, context)
    return np.asarray(codes == names.index(node.value))


def _extreme(node: tree.Extreme, context: MaskContext) -> Mask:
    base = base_population(context, node.field.run)
    total = np.count_nonzero(base)
    count = math.ceil(node.amount * total / 100) if node.percent else int(node.amount)
    return top_k(field_values(node.field, context), base, count, node.which == "worst")


def field_values(field: tree.Field, context: MaskContext) -> Values:
    """A field of every instance in the unit of the index, shape (N,), NaN for NULL."""
    return _nan_for_null(field, _field_column(field, context))


def _nan_for_null(field: tree.Field, column: NDArray[Any]) -> Values:
    """A field's column, or a part of it, with NaN for NULL."""
    if field.name in fields.RANKS:
        return np.where(column > 0, column, np.nan)
    if field.name == "seq":
        return np.where(column >= 0, column, np.nan)
    return np.asarray(column, dtype=np.float64)


def _field_column(field: tree.Field, context: MaskContext) -> NDArray[Any]:
    """The values of a numeric field, shape (N,); ranks are counted within the population."""
    if field.name not in fields.RANKS:
        return _column(fields.NUMERIC[field.name].path, field.run, context)
    run, population = field.run or context.run, context.population
    return context.evaluated.get(
        ("ranks", field.name, run, population.with_trained),
        lambda: population_ranks(population, context.run_columns(run), fields.RANKS[field.name]),
    )


def _column(path: str, run: str | None, context: MaskContext) -> NDArray[Any]:
    return fields.column(path, context.instances, context.run_columns(run or context.run))
