"""Targets of the session: a place and a selection whose columns may have to be loaded first."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from s2rstore.errors import RequestError
from s2rstore.language import Node, evaluation, expand
from s2rstore.language.fields import NUMERIC, TEXT
from s2rstore.language.name_resolution import used_fields
from s2rstore.language.syntax_tree import (
    Everything,
    Extreme,
    Field,
    LabelGain,
    Like,
    Paired,
    Training,
    leaves,
)
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.session import undo_history
from s2rtui.session.context import SessionContext
from s2rtui.session.state import State, Target

SMALL_STORE = 20_000
"""Instances whose columns are read fast enough for the UI thread."""
_SIDE_COLUMNS = ("x", "y", "heading", "error", "heading_error", "room", "u", "v", "outlier")
_POPULATION_COLUMNS = ("valid", "trained", "paired")
_RUN_COLUMNS = ("shift", *_POPULATION_COLUMNS)
_TRUTH_COLUMNS = ("x", "y", "heading", "seq", "trajectory", "room", "curvature")


# --- loaded columns --------------------------------------------------------------------------


def run_is_loaded(store: Store, run: str) -> bool:
    """Whether views of a run can be drawn without reading its columns first."""
    if len(store.instances) <= SMALL_STORE:
        return True
    sides = all(store.has_loaded(run, side, _SIDE_COLUMNS) for side in SIDES)
    return sides and store.has_loaded(run, None, _RUN_COLUMNS)


def expression_is_loaded(store: Store, run: str, node: Node) -> bool:
    """Whether an expanded expression can be evaluated on a run without reading columns."""
    if len(store.instances) <= SMALL_STORE:
        return True
    return all(_leaf_is_loaded(store, run, leaf) for leaf in leaves(node))


def _leaf_is_loaded(store: Store, run: str, leaf: Node) -> bool:
    if isinstance(leaf, Like | LabelGain):
        return False  # compares embeddings, or reads the gains of a label
    if isinstance(leaf, Training | Paired):
        return store.has_loaded(leaf.run or run, None, _POPULATION_COLUMNS)
    if isinstance(leaf, Extreme):  # ranks within the base population
        ranked = leaf.field.run or run
        if not store.has_loaded(ranked, None, _POPULATION_COLUMNS):
            return False
    return all(_field_is_loaded(store, run, used) for used in used_fields(leaf))


def _field_is_loaded(store: Store, run: str, used: Field) -> bool:
    path = NUMERIC[used.name].path if used.name in NUMERIC else TEXT[used.name].path
    owner, _, name = path.rpartition(".")
    side = next((side for side in SIDES if side == owner), None)
    of = None if owner == "instances" else used.run or run
    return used.name in ("iid", "has") or store.has_loaded(of, side, [name])


def load_columns(store: Store, target: Target, is_current: Callable[[], bool]) -> None:
    """Read the columns that views draw of a run, and evaluate the target's selection once."""
    columns, truth = store.run_columns(target.run), store.instances
    sides = ((columns.side(side), _SIDE_COLUMNS) for side in SIDES)
    for owner, names in ((truth, _TRUTH_COLUMNS), (columns, _RUN_COLUMNS), *sides):
        for name in names:
            if not is_current():
                return
            getattr(owner, name)
    with suppress(RequestError):  # the reducer reports an expression that cannot be evaluated
        query = evaluation.query(
            store, target.loading or Everything(), target.run, target.trajectories,
            with_trained=target.with_trained,
        )  # fmt: skip
        _ = query.selected


# --- targets ---------------------------------------------------------------------------------


def place_of(shown: State | Target) -> Target:
    """The run, generation and population of a state or a target, without an expression."""
    return Target(
        shown.run,
        shown.generation,
        trajectories=shown.trajectories,
        with_trained=shown.with_trained,
    )


def final(state: State) -> Target:
    """The pending target, or the present place if nothing is pending."""
    return state.pending or place_of(state)


def with_expression(state: State, place: Target, node: Node) -> Target:
    """Select `node` at a place, as the next step of the history."""
    target = replace(place_of(place), node=node)
    return replace(target, history=undo_history.next_history(state, target))


def expand_saved_names(context: SessionContext, node: Node) -> Node:
    """The syntax tree with saved selections put in place of their names; raises ExpressionError."""
    return expand(node, evaluation.vocabulary(context.store, context.notes.nodes))


def node_to_load(context: SessionContext, state: State, target: Target) -> Node | None:
    """The expression to evaluate in the background before the target can be shown; else None.

    Raises ExpressionError.
    """
    if not context.defers_loading:
        return None
    store = context.store
    node = expand_saved_names(context, target.node or state.node)
    is_loaded = target.run == state.run or run_is_loaded(store, target.run)
    if target.generation != state.generation or not is_loaded:
        return node
    return None if expression_is_loaded(store, target.run, node) else node


def plan(context: SessionContext, state: State, node: Node) -> tuple[Target, Target | None]:
    """The target of selecting `node`, and the target that remains pending after it.

    The first is `loading` if columns have to be read before it can be selected. Raises
    ExpressionError.
    """
    target, here = with_expression(state, final(state), node), place_of(state)
    if (loading := node_to_load(context, state, replace(here, node=node))) is not None:
        return replace(target, loading=loading), None
    if state.pending is None or place_of(state.pending) == here:
        return target, None
    expanded = expand_saved_names(context, node)
    return target, replace(place_of(state.pending), loading=expanded)
