"""Evaluate an expression in a state: the selected instances and the cursor among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.index.population import left_out_text
from s2rstore.language import Node, Query, evaluation, located, widening
from s2rstore.metrics.top_k import first_largest, top_k
from s2rstore.reader import Store
from s2rtui.analysis.binning import selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.session import saved_selection_diff
from s2rtui.session.context import SessionContext
from s2rtui.session.state import History, State, Target
from s2rtui.user_data.notebook import Notes

_IMAGE_FIELDS = frozenset({"iid", "seq", "traj", "timestamp"})
"""Fields that instances without poses have."""
_RANKED_ERRORS = 4096
"""Largest errors that are searched for the cursor before the whole selection is."""


def query_of(store: Store, state: State, notes: Notes, node: Node | None = None) -> Query:
    """An expression, by default the selected one, on the instances that count in a state."""
    return evaluation.query(
        store, node or state.node, state.run, state.trajectories, notes.nodes, state.with_trained
    )


def evaluate(
    context: SessionContext,
    state: State,
    node: Node,
    history: History,
    pending: Target | None = None,
) -> State:
    """The state with `node` selected; brush and pending operator are cleared.

    `history` holds the selections before and after it, `pending` is the target that
    remains to be loaded. Raises ExpressionError.
    """
    store, notes = context.store, context.notes
    query = query_of(store, state, notes, node)
    selected = query.selected
    unpaired = query.unpaired if query.unpaired.any() else None
    chosen = selected if unpaired is None else query.instances
    suggested, messages = None, []
    if not chosen.any():
        empty, suggested = _nothing_selected(store, query)
        messages.append(empty)
    if query.trained_left_out:
        messages.append(left_out_text(query.trained_left_out))
    if notes.selections:
        messages.append(saved_selection_diff.describe_saved_names(query, state, notes))
    base = context.base_populations.mask(store, state, query)
    past, future = history
    return replace(
        state,
        node=located(node),
        selected=selected,
        base=base,
        trained=context.base_populations.trained(store, state, query),
        chosen=chosen,
        unpaired=unpaired,
        unpaired_text=query.unpaired_text,
        cursor=_cursor(store, state, selected, chosen, base),
        past=past,
        future=future,
        pending=pending,
        operator="replace",
        brush=None,
        suggested=suggested,
        message="; ".join(part for part in messages if part),
        is_error=False,
        keeps_message=False,
    )


def _nothing_selected(store: Store, query: Query) -> tuple[str, Node | None]:
    """The message for an empty selection, and the expression that it suggests.

    The message says which wider expressions would select something (if no trained instance would
    be selected), or that the expression needs poses that the data set does not have.
    """
    if store.has_poses:
        suggests = not query.trained_left_out
        wider = widening.widenings(query.node, query.context) if suggests else []
        if not wider:
            return "nothing is selected", None
        first, *others = wider
        suggestions = [f"{first.change} would give {first.count} (key Y)"]
        suggestions += [f"{other.change} {other.count}" for other in others]
        return f"nothing is selected; {', '.join(suggestions)}", first.node
    needs_poses = any(field.name not in _IMAGE_FIELDS for field in query.fields)
    if not store.missing_run or not needs_poses:
        return "nothing is selected", None
    return f"nothing is selected: {store.missing_run}", None


def _cursor(
    store: Store,
    state: State,
    selected: NDArray[np.bool_],
    chosen: NDArray[np.bool_],
    base: NDArray[np.bool_],
) -> int | None:
    """The present cursor if it is still selected, else the instance with the worst real error.

    Without errors it is the first one.
    """
    pool = chosen if chosen.any() else base
    if state.cursor is not None and pool[state.cursor]:
        return state.cursor
    if chosen.any() and not selected.any():
        return int(chosen.argmax())
    pool = selected if selected.any() else base
    errors = store.run_columns(state.run).real.error
    worst = _worst_iids(errors)
    inside = pool[worst]
    if inside.any():
        return int(worst[inside.argmax()])
    members = selection_indices(pool, base).members
    if store.missing_run:
        return int(members[0]) if members.size else None
    return first_largest(errors, members)


@cached_by_identity(4)
def _worst_iids(errors: NDArray[np.floating]) -> NDArray[np.intp]:
    """The iids of the largest known errors in descending order, ties by iid."""
    known = ~np.isnan(errors)
    count = min(_RANKED_ERRORS, errors.size)
    largest_first = np.flatnonzero(top_k(errors, known, count, largest=True))
    return largest_first[np.argsort(-errors[largest_first], kind="stable")]
