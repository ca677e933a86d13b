"""Expressions evaluated in a state: what is selected, and where the cursor stands then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.language import (
    MaskContext,
    Node,
    base_population,
    evaluation,
    mask,
    parse,
    to_text,
)
from s2rstore.metrics.top_k import first_largest, top_k
from s2rstore.reader import Store
from s2rtui.analysis.binning import selection_indices
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.session import pending_target, saved_selection_diff
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes

_WORST = 4096
"""Largest errors that are looked for in a selection before all of it is looked at."""


class Selecting:
    """Evaluates; one base population stays one array for as long as it holds the same."""

    def __init__(self) -> None:
        self._bases: dict[tuple[object, ...], NDArray[np.bool_]] = {}

    def selected(self, store: Store, notes: Notes, state: State, expression: str | Node) -> State:
        """The state after selecting. Raises ExpressionError."""
        node = parse(expression) if isinstance(expression, str) else expression
        context = evaluation.context(store, state.run, state.trajectories, notes.nodes)
        chosen = mask(node, context)
        text = to_text(node)
        step = pending_target.step(state, pending_target.here(state), text)
        told = ["" if chosen.any() else "nothing is selected"]
        told.append(saved_selection_diff.told(node, state, context, notes))
        base = self._base(store, state, context)
        return replace(
            state,
            expression=text,
            selected=chosen,
            base=base,
            cursor=_kept_cursor(store, state, chosen, base),
            past=step.past,
            future=step.future,
            awaited=pending_target.superseded(state, node, context.words),
            operator="replace",
            brush=None,
            message="; ".join(part for part in told if part),
            is_error=False,
        )

    def kept(self, store: Store, notes: Notes, state: State) -> State:
        """The expression evaluated in another situation, or all where it means nothing there."""
        try:
            return self.selected(store, notes, state, state.expression)
        except RequestError as error:
            made = self.selected(store, notes, state, "all")
            told = f"all selected: {state.expression} means nothing here ({error})"
            return replace(made, message=told)

    def forget(self, generation: int) -> None:
        """Keep nothing of a generation."""
        self._bases = {key: base for key, base in self._bases.items() if key[0] != generation}

    def _base(self, store: Store, state: State, context: MaskContext) -> NDArray[np.bool_]:
        key = (store.generation, state.run, state.trajectories)
        if key not in self._bases:
            found = base_population(context)
            known = (base for base in self._bases.values() if np.array_equal(base, found))
            self._bases[key] = next(known, found)
        return self._bases[key]


def _kept_cursor(
    store: Store, state: State, selected: NDArray[np.bool_], base: NDArray[np.bool_]
) -> int | None:
    """The cursor where it is still inside, else the selection's worst real error."""
    pool = selected if selected.any() else base
    if state.cursor is not None and pool[state.cursor]:
        return state.cursor
    errors = store.run_columns(state.run).real.error
    worst = _worst(ArrayKey(errors))
    inside = pool[worst]
    if inside.any():
        return int(worst[inside.argmax()])
    return first_largest(errors, selection_indices(pool, base).members)


@cached_by_identity(4)
def _worst(errors: ArrayKey) -> NDArray[np.intp]:
    """The iids of the largest known errors, the first the largest, ties by iid."""
    column = np.asarray(errors.array)
    known = ~np.isnan(column)
    chosen = np.flatnonzero(top_k(column, known, min(_WORST, column.size), largest=True))
    return chosen[np.argsort(-column[chosen], kind="stable")]
