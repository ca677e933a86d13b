"""Evaluate expressions on an open store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.index import schema
from s2rstore.language import (
    MaskContext,
    Node,
    SqlContext,
    Vocabulary,
    expand,
    mask,
    parse,
    to_sql,
)
from s2rstore.language.fields import is_truth
from s2rstore.language.name_resolution import used_fields
from s2rstore.language.syntax_tree import Like, leaves
from s2rstore.metrics import nearest_neighbours
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES, Side

Saved = Mapping[str, Node]


def vocabulary(store: Store, saved: Saved | None = None) -> Vocabulary:
    """The names that expressions on this store may use; only computed runs count."""
    truth = store.instances
    runs = tuple(name for name, run in store.runs.items() if run.key)
    return Vocabulary(runs, truth.room_names, truth.trajectory_names, saved or {})


def context(
    store: Store,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
) -> MaskContext:
    """The context to evaluate masks of a run, by default of the first computed one."""
    return MaskContext(
        store.instances, store.run_name(run), store.run_columns, vocabulary(store, saved),
        None if trajectories is None else tuple(trajectories),
        partial(_neighbours, store), store.evaluated,
    )  # fmt: skip


def select(
    store: Store,
    expression: str,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
) -> NDArray[np.bool_]:
    """The instances that an expression selects, shape (N,).

    Raises ExpressionError, a RequestError that names the column.
    """
    return mask(parse(expression), context(store, run, trajectories, saved))


def sql(
    store: Store,
    expression: str,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
) -> tuple[str, list[object]]:
    """The same selection as a DuckDB query with bound parameters.

    Raises RequestError for a field of predictions where `run` is `NO_RUN` in a data set with poses.
    """
    node, name = parse(expression), store.run_name(run)
    if name == NO_RUN and store.has_poses:
        _require_no_run(store, expand(node, vocabulary(store, saved)))
    missing = {f"{side}_{name}" for name in store.missing_columns("prediction") for side in SIDES}
    context = SqlContext(
        name, vocabulary(store, saved),
        None if trajectories is None else tuple(trajectories), partial(_neighbours, store),
        frozenset(missing | store.missing_columns("instance")), store.stored_rooms, pairs(store),
    )  # fmt: skip
    return to_sql(node, context)


def _require_no_run(store: Store, node: Node) -> None:
    """Raise RequestError if an expanded expression depends on predictions."""
    for leaf in leaves(node):
        used = [field.name for field in used_fields(leaf) if not is_truth(field.name)]
        if isinstance(leaf, Like):
            used = ["like"]
        if used:
            raise RequestError(f"{store.path}: {used[0]} needs predictions: {store.no_run}")


def pairs(store: Store) -> str:
    """The relation of instances with their predictions: view `pair`, or one without any."""
    if store.has_computed_run:
        return "pair"
    return schema.unpredicted(store.missing_columns("instance"))


def _neighbours(
    store: Store, run: str, side: Side, iid: int, count: int, trajectories: tuple[str, ...] | None
) -> NDArray[np.int64]:
    return nearest_neighbours.neighbours(store, run, side, iid, count, trajectories)[0]
