"""Evaluate expressions on an open store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.image_faults import FAULTS
from s2rstore.index import pair_view
from s2rstore.index.population import Population
from s2rstore.language import (
    MaskContext,
    Node,
    Query,
    SqlContext,
    Vocabulary,
    parse,
    to_sql,
)
from s2rstore.language.fields import is_truth
from s2rstore.language.name_resolution import used_fields
from s2rstore.language.syntax_tree import LabelGain, Like, leaves
from s2rstore.metrics import nearest_neighbours
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, Side

Saved = Mapping[str, Node]


def vocabulary(store: Store, saved: Saved | None = None) -> Vocabulary:
    """The names that expressions on this store may use; only computed runs count."""
    truth = store.instances
    runs = tuple(name for name, run in store.runs.items() if run.key)
    domains = tuple(store.domains)
    labels = tuple(dict.fromkeys(store.label_names.values()))
    faults = tuple(FAULTS) if store.checked_domains else ()
    return Vocabulary(
        runs, truth.room_names, truth.trajectory_names, saved or {}, domains, labels, faults=faults
    )


def context(
    store: Store,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
    with_trained: bool = False,
) -> MaskContext:
    """The context to evaluate masks of a run, by default of the first computed one.

    `trajectories` are those in view, by default all. Instances that the run's model was trained on
    are left out unless `with_trained`.
    """
    return MaskContext(
        store.instances, store.run_name(run), store.run_columns, vocabulary(store, saved),
        Population(None if trajectories is None else tuple(trajectories), with_trained),
        partial(_neighbours, store), store.selection_cache,
    )  # fmt: skip


def query(
    store: Store,
    expression: str | Node,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
    with_trained: bool = False,
) -> Query:
    """An expression, as text or parsed, on the instances of `context`.

    Raises ExpressionError, a RequestError that names the column.
    """
    node = parse(expression) if isinstance(expression, str) else expression
    return Query(node, context(store, run, trajectories, saved, with_trained))


def select(
    store: Store,
    expression: str | Node,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
    with_trained: bool = False,
) -> NDArray[np.bool_]:
    """All instances that a `query` selects, shape (N,).

    Those without an image of a side have no errors; `query(...).selected` leaves them out.
    """
    return query(store, expression, run, trajectories, saved, with_trained).instances


def require_predictions(store: Store, asked: Query) -> None:
    """Raise RequestError where a query without a run, on a store with poses, names predictions."""
    if asked.context.run != NO_RUN or not store.has_poses:
        return
    for leaf in leaves(asked.expanded):
        used = [field.name for field in used_fields(leaf) if not is_truth(field.name)]
        if isinstance(leaf, Like | LabelGain):
            used = ["like" if isinstance(leaf, Like) else "harm.label"]
        if used:
            raise RequestError(f"{store.path}: {used[0]} needs predictions: {store.no_run}")


def sql(
    store: Store,
    expression: str | Node,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
    with_trained: bool = False,
) -> tuple[str, list[object]]:
    """The same selection as a DuckDB query with bound parameters.

    Raises RequestError for a field of predictions where `run` is `NO_RUN` in a data set with poses.
    """
    asked = query(store, expression, run, trajectories, saved, with_trained)
    require_predictions(store, asked)
    of = asked.context
    context = SqlContext(
        of.run, of.words, of.population, of.neighbours, store.stored_rooms,
        rows_of_run(store, of.run), _has_unpaired(store, of.run),
    )  # fmt: skip
    return to_sql(asked.node, context)


def rows_of_run(store: Store, run: str) -> str:
    """SQL text of the table of a run's instances and predictions, for a FROM clause.

    It is view `pair`, with rows for the instances that lack an image of a side, or one without
    predictions.
    """
    if not store.has_computed_run:
        return pair_view.unpredicted()
    return pair_view.with_all_instances(run) if _has_unpaired(store, run) else "pair"


def _has_unpaired(store: Store, run: str) -> bool:
    return not store.run_columns(run).paired.all()


def _neighbours(
    store: Store, run: str, side: Side, iid: int, count: int, population: Population
) -> NDArray[np.int64]:
    return nearest_neighbours.neighbours(store, run, side, iid, count, population)[0]
