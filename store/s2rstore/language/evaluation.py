"""Evaluate expressions on an open store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.index import pair_view
from s2rstore.index.population import Population
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
from s2rstore.language.syntax_tree import Field, Like, Named, Training, leaves
from s2rstore.metrics import nearest_neighbours
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, TRAINING_SPLITS, Side

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
    with_trained: bool = False,
) -> MaskContext:
    """The context to evaluate masks of a run, by default of the first computed one.

    `trajectories` are those in view, by default all. Instances that the run's model was trained on
    are left out unless `with_trained`.
    """
    return MaskContext(
        store.instances, store.run_name(run), store.run_columns, vocabulary(store, saved),
        _population(trajectories, with_trained), partial(_neighbours, store), store.evaluated,
    )  # fmt: skip


def select(
    store: Store,
    expression: str,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
    with_trained: bool = False,
) -> NDArray[np.bool_]:
    """The instances that an expression selects among those of `context`, shape (N,).

    Raises ExpressionError, a RequestError that names the column.
    """
    return mask(parse(expression), context(store, run, trajectories, saved, with_trained))


def trained_left_out(node: Node, used: MaskContext, selected: NDArray[np.bool_]) -> int:
    """How many trained instances an expression selects beyond `selected`, its result in `used`.

    0 where the context includes trained instances, and for expressions that select new ones and
    name no split of training images.
    """
    columns = used.run_columns(used.run)
    if used.population.with_trained or not columns.trained.any():
        return 0
    expanded = expand(node, used.words)
    if selected.any() and not any(map(_names_trained, leaves(expanded))):
        return 0
    included = replace(used, population=replace(used.population, with_trained=True))
    return int(np.count_nonzero(mask(expanded, included) & columns.trained))


def _names_trained(leaf: Node) -> bool:
    """Whether a leaf asks for instances that a model was trained on."""
    if isinstance(leaf, Named):
        return leaf.field.name.endswith("split") and leaf.value in TRAINING_SPLITS
    return isinstance(leaf, Training) and leaf.trained


def named_fields(node: Node, store: Store, saved: Saved | None = None) -> set[Field]:
    """The fields that an expression and the saved selections in it name."""
    expanded = expand(node, vocabulary(store, saved))
    found: set[Field] = set()
    for leaf in leaves(expanded):
        found |= set(used_fields(leaf))
    return found


def sql(
    store: Store,
    expression: str,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    saved: Saved | None = None,
    with_trained: bool = False,
) -> tuple[str, list[object]]:
    """The same selection as a DuckDB query with bound parameters.

    Raises RequestError for a field of predictions where `run` is `NO_RUN` in a data set with poses.
    """
    node, name = parse(expression), store.run_name(run)
    if name == NO_RUN and store.has_poses:
        _require_no_run(store, expand(node, vocabulary(store, saved)))
    context = SqlContext(
        name, vocabulary(store, saved),
        _population(trajectories, with_trained), partial(_neighbours, store),
        store.stored_rooms, pairs(store),
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
    return pair_view.unpredicted()


def _neighbours(
    store: Store, run: str, side: Side, iid: int, count: int, population: Population
) -> NDArray[np.int64]:
    return nearest_neighbours.neighbours(store, run, side, iid, count, population)[0]


def _population(trajectories: Sequence[str] | None, with_trained: bool) -> Population:
    return Population(None if trajectories is None else tuple(trajectories), with_trained)
