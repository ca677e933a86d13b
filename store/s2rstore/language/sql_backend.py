"""From nodes to DuckDB SQL with bound parameters: the scripts' back end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from s2rstore.geometry import angles
from s2rstore.geometry.curvature import STRAIGHT_BELOW
from s2rstore.index.population import NEW_INSTANCES, Population, new_to_run
from s2rstore.language import fields, lasso
from s2rstore.language import syntax_tree as tree
from s2rstore.language.name_resolution import (
    Neighbours,
    Vocabulary,
    expand,
    similar_instances,
    used_fields,
)
from s2rstore.records import NO_RUN, SIDES

_SIGNS = {"!=": "<>"}
"""SQL's spelling of the operators of comparisons that differ."""


@dataclass(frozen=True, slots=True)
class SqlContext:
    """The current run and the population that counts.

    `neighbours` resolves `like`. `stored_rooms` gives the index's own name of a room for the one
    that is shown, where they differ. `pairs` is the relation of instances: view `pair`, or
    `pair_view.unpredicted` where there are no predictions. With `has_unpaired` it has rows of
    instances that lack an image of a side, which are selected as well.
    """

    run: str
    words: Vocabulary
    population: Population = NEW_INSTANCES
    neighbours: Neighbours | None = None
    stored_rooms: Mapping[str, str] = field(default_factory=dict)
    pairs: str = "pair"
    has_unpaired: bool = False


@dataclass(slots=True)
class _Writer:
    """Collects parameters in the order of their question marks."""

    context: SqlContext
    parameters: list[Any] = field(default_factory=list)

    def bind(self, value: Any) -> str:
        self.parameters.append(value)
        return "?"

    def column(self, field: tree.Field) -> str:
        """A numeric column on alias q."""
        return f"q.{fields.NUMERIC[field.name].column}"


def to_sql(node: tree.Node, context: SqlContext) -> tuple[str, list[Any]]:
    """`SELECT iid ... ORDER BY iid` and its parameters. Raises ExpressionError."""
    expanded = expand(node, context.words)
    used = {field.name for leaf in tree.leaves(expanded) for field in used_fields(leaf)}
    if ranks := fields.RANKS.keys() & used:
        context = replace(context, pairs=_ranked(context, sorted(ranks)))
    writer = _Writer(context)
    base = _base(writer, None, "q")
    if context.has_unpaired:
        base = f"({base} OR {_unpaired(writer)})"
    condition = _condition(expanded, writer)
    return (
        f"SELECT q.iid FROM {context.pairs} q WHERE {base} AND {condition} ORDER BY q.iid",
        writer.parameters,
    )


def _ranked(context: SqlContext, ranks: Sequence[str]) -> str:
    """`context.pairs` with ranks among the instances that count, in any trajectory."""
    if context.population.with_trained or context.run == NO_RUN:
        return context.pairs
    replaced = []
    for side in (fields.RANKS[name] for name in ranks):
        error = f"p.{side}_error_m"
        counts = f"({new_to_run('p')} AND p.{side}_rank IS NOT NULL)"
        order = f"PARTITION BY p.run, {counts} ORDER BY {error}, p.iid"
        place = f"CASE WHEN {counts} THEN row_number() OVER ({order}) END"
        replaced.append(f"{place} AS {side}_rank")
    return f"(SELECT * REPLACE ({', '.join(replaced)}) FROM {context.pairs} p)"


def _base(writer: _Writer, run: str | None, alias: str) -> str:
    """The condition on `alias` of the base population of a run, by default the current one."""
    parts = [f"{alias}.run = {writer.bind(run or writer.context.run)}"]
    parts += _predicted(writer, alias)
    population = writer.context.population
    if population.trajectories is not None:
        listed = writer.bind(list(population.trajectories))
        parts.append(f"list_contains({listed}, {alias}.trajectory)")
    if not population.with_trained:
        parts.append(new_to_run(alias))
    return " AND ".join(parts)


def _unpaired(writer: _Writer) -> str:
    """The condition on q of `Population.unpaired` of the current run."""
    predicted = " AND ".join(_predicted(writer, "q")) or "true"
    parts = [f"q.run = {writer.bind(writer.context.run)}", f"NOT ({predicted})"]
    parts.append(f"NOT {_paired(writer, None)}")
    if writer.context.population.trajectories is not None:
        listed = writer.bind(list(writer.context.population.trajectories))
        parts.append(f"list_contains({listed}, q.trajectory)")
    return " AND ".join(parts)


def _paired(writer: _Writer, run: str | None) -> str:
    """The condition that an instance has an image in both domains of a run."""
    name, sides = run or writer.context.run, []
    for side in SIDES:
        domains = f"SELECT domain FROM domain WHERE kind = '{side}'"
        if name != NO_RUN:
            domains = f"SELECT {side}_domain FROM run WHERE run = {writer.bind(name)}"
        sides.append(f"q.iid IN (SELECT iid FROM frame WHERE domain IN ({domains}))")
    return f"({' AND '.join(sides)})"


def _predicted(writer: _Writer, alias: str) -> list[str]:
    """The conditions that both sides of a row have a prediction; none in a data set without."""
    if writer.context.run == NO_RUN:
        return []
    return [_known(f"{alias}.{side}_error_m") for side in SIDES]


def _known(column: str) -> str:
    return f"({column} IS NOT NULL AND NOT isnan({column}::DOUBLE))"


def _condition(node: tree.Node, writer: _Writer) -> str:
    """A condition in parentheses; operands of the same operator share one pair of parentheses."""
    first, links = tree.chain(node)
    parts, joined = [_operand(first, writer)], ""
    for link in links:
        operator = "OR" if isinstance(link, tree.Or) else "AND"
        if joined not in ("", operator):
            parts = [f"({f' {joined} '.join(parts)})"]
        right = _condition(link.right, writer)
        parts.append(f"NOT {right}" if isinstance(link, tree.Minus) else right)
        joined = operator
    return f"({f' {joined} '.join(parts)})" if links else parts[0]


def _operand(node: tree.Node, writer: _Writer) -> str:
    match node:
        case tree.Not(inner):
            return f"(NOT {_condition(inner, writer)})"
        case tree.Everything():
            return "true"
        case tree.Nothing():
            return "false"
        case tree.Ids(ranges):
            parts = [f"q.iid BETWEEN {writer.bind(a)} AND {writer.bind(b)}" for a, b in ranges]
            return f"({' OR '.join(parts) or 'false'})"
        case tree.Compare(field, operator, value):
            column = writer.column(field)
            sign = _SIGNS.get(operator, operator)
            compared = value * fields.NUMERIC[field.name].scale
            return _among(
                writer, field, lambda w: f"{_known(column)} AND {column} {sign} {w.bind(compared)}"
            )
        case tree.Between():
            return _among(writer, node.field, lambda w: _between(node, w))
        case tree.Around():
            return _among(writer, node.field, lambda w: _around(node, w))
        case tree.Named():
            return _among(writer, node.field, lambda w: _named(node, w))
        case tree.Extreme():
            return _extreme(node, writer)
        case tree.Box(x, y, corners):
            u, v = writer.column(x), writer.column(y)
            return _among(writer, x, lambda w: (
                f"{u} >= {w.bind(corners[0])} AND {v} >= {w.bind(corners[1])} AND "
                f"{u} <= {w.bind(corners[2])} AND {v} <= {w.bind(corners[3])}"
            ))  # fmt: skip
        case tree.Near(x, y, centre, radius):
            dx = f"({writer.column(x)} - {{}})"
            dy = f"({writer.column(y)} - {{}})"
            return _among(writer, x, lambda w: (
                f"{dx.format(w.bind(centre[0]))} * {dx.format(w.bind(centre[0]))} + "
                f"{dy.format(w.bind(centre[1]))} * {dy.format(w.bind(centre[1]))} "
                f"<= {w.bind(radius * radius)}"
            ))  # fmt: skip
        case tree.Lasso(x):
            return _among(writer, x, lambda w: _lasso(node, w))
        case tree.Like():
            context = writer.context
            iids = similar_instances(node, context.run, context.population, context.neighbours)
            return f"q.iid IN (SELECT unnest({writer.bind(iids.tolist())}::INTEGER[]))"
        case tree.LabelGain(label, operator, value, run):
            return (
                "q.iid IN (SELECT iid FROM label_gain JOIN label USING (label) WHERE "
                f"run = {writer.bind(run or writer.context.run)} AND name = {writer.bind(label)} "
                f"GROUP BY iid HAVING sum(gain) {_SIGNS.get(operator, operator)} "
                f"{writer.bind(value)})"
            )
        case tree.Paired(run):
            return _paired(writer, run)
        case tree.Training(trained, run):
            is_new = f"{'NOT ' if trained else ''}({new_to_run('q')})"
            condition = " AND ".join([*_predicted(writer, "q"), is_new])
            return _among(writer, tree.Field("split", run), lambda w: condition)
        case tree.Bend(straight):
            sign = "<" if straight else ">="
            column = "q.curvature_deg"
            limit = writer.bind(STRAIGHT_BELOW)
            return f"coalesce({_known(column)} AND abs({column}) {sign} {limit}, false)"
        case _:
            raise TypeError(f"{type(node).__name__} is not a leaf")


def _among(writer: _Writer, field: tree.Field, condition: Any) -> str:
    """The instances whose row of the field's run satisfies a condition on alias q.

    Ground truth does not depend on the run, and the outer query reads the row of the current run.
    That of another run takes a subquery, whose q hides the outer one.
    """
    joins = field.name in fields.TEXT  # a room of a prediction: slow unless it has its own query
    is_current = field.run in (None, writer.context.run)
    if fields.is_truth(field.name) or (is_current and not joins):
        return f"coalesce({condition(writer)}, false)"
    run = writer.bind(field.run or writer.context.run)
    pairs = writer.context.pairs
    return f"q.iid IN (SELECT q.iid FROM {pairs} q WHERE q.run = {run} AND {condition(writer)})"


def _between(node: tree.Between, writer: _Writer) -> str:
    column, field = writer.column(node.field), fields.NUMERIC[node.field.name]
    if not field.angle:
        low, high = writer.bind(node.low * field.scale), writer.bind(node.high * field.scale)
        return f"{_known(column)} AND {column} >= {low} AND {column} <= {high}"
    ends = angles.heading_range(node.low, node.high)
    if ends is None:
        return _known(column)
    word = "AND" if ends[0] <= ends[1] else "OR"
    low, high = writer.bind(ends[0]), writer.bind(ends[1])
    return f"{_known(column)} AND ({column} >= {low} {word} {column} <= {high})"


def _around(node: tree.Around, writer: _Writer) -> str:
    column, field = writer.column(node.field), fields.NUMERIC[node.field.name]
    if not field.angle:
        centre = writer.bind(node.centre * field.scale)
        tolerance = writer.bind(node.tolerance * field.scale)
        return f"{_known(column)} AND abs({column} - {centre}) <= {tolerance}"
    middle = math.radians(angles.wrap_degrees(node.centre))
    first = f"abs({column} - {writer.bind(middle)})"
    turn = writer.bind(angles.TURN)
    second = f"abs({column} - {writer.bind(middle)})"
    limit = writer.bind(math.radians(node.tolerance) + angles.ROUNDING)
    return f"{_known(column)} AND least({first}, {turn} - {second}) <= {limit}"


def _lasso(node: tree.Lasso, writer: _Writer) -> str:
    """An odd number of edges to the right, as `lasso` defines it."""
    x, y = writer.column(node.x), writer.column(node.y)
    parts = ["0"]
    for edge in lasso.edges(node.corners):
        low, high = writer.bind(edge.low), writer.bind(edge.high)
        at = f"({y} - {writer.bind(edge.low)}) / {writer.bind(edge.rise)}"
        at = f"{at} * {writer.bind(edge.run)} + {writer.bind(edge.x)}"
        parts.append(f"(CASE WHEN {y} >= {low} AND {y} < {high} AND {x} < {at} THEN 1 ELSE 0 END)")
    return f"{_known(x)} AND {_known(y)} AND ({' + '.join(parts)}) % 2 = 1"


def _named(node: tree.Named, writer: _Writer) -> str:
    side, _, name = node.field.name.rpartition(".")
    value = node.value
    if name == "room":
        value = writer.context.stored_rooms.get(value, value)
    if node.field.name == "has":
        return f"q.iid IN (SELECT iid FROM frame WHERE domain = {writer.bind(value)})"
    if node.field.name == "label":
        return (
            "q.iid IN (SELECT iid FROM frame_label JOIN label USING (label) WHERE "
            f"name = {writer.bind(value)})"
        )
    if node.field.name == "health":
        return f"q.iid IN (SELECT iid FROM frame_fault WHERE fault = {writer.bind(value)})"
    if node.field.name == "split":
        return _split(value, writer)
    if name != "room" or not side:
        return f"q.{fields.TEXT[node.field.name].column} = {writer.bind(value)}"
    x, y = f"q.{side}_x_m", f"q.{side}_y_m"
    return (
        "(SELECT arg_min(r.room, r.position) FROM room r WHERE "
        f"{x} >= r.x0 AND {x} <= r.x1 AND {y} >= r.y0 AND {y} <= r.y1) = {writer.bind(value)}"
    )


def _split(value: str, writer: _Writer) -> str:
    """The first of `records.SPLITS` among the splits of both sides is `value`."""
    columns = [f"q.{side}_split" for side in SIDES]
    is_value = " OR ".join(f"{column} = {writer.bind(value)}" for column in columns)
    earlier = writer.context.words.splits[: writer.context.words.splits.index(value)]
    if not earlier:
        return f"({is_value})"
    is_earlier = " OR ".join(
        f"list_contains({writer.bind(list(earlier))}, {column})" for column in columns
    )
    return f"({is_value}) AND NOT coalesce({is_earlier}, false)"


def _extreme(node: tree.Extreme, writer: _Writer) -> str:
    column, pairs = writer.column(node.field), writer.context.pairs
    direction = "ASC" if node.which == "best" else "DESC"
    inner = (
        f"SELECT q.iid FROM {pairs} q WHERE {_base(writer, node.field.run, 'q')} "
        f"AND {_known(column)}"
    )
    if node.percent:
        amount = writer.bind(float(node.amount))
        base = _base(writer, node.field.run, "b")
        count = f"(SELECT ceil({amount} * count(*) / 100)::BIGINT FROM {pairs} b WHERE {base})"
    else:
        count = writer.bind(int(node.amount))
    return f"q.iid IN ({inner} ORDER BY {column} {direction}, q.iid LIMIT {count})"
