"""Describe how a saved selection differs where it is used from where it was saved."""

from __future__ import annotations

import numpy as np

from s2rstore.language import Query
from s2rstore.language.canonical_text import quoted
from s2rstore.language.syntax_tree import Saved, leaves
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes, SavedSelection


def describe_saved_names(query: Query, state: State, notes: Notes) -> str:
    """How the saved selections named in an expression differ here; empty if they do not."""
    parts = []
    for leaf in dict.fromkeys(leaf for leaf in leaves(query.node) if isinstance(leaf, Saved)):
        saved = notes.selections.get(leaf.name)
        if saved is not None and not _is_same_place(state, saved):
            count = Query(leaf, query.context).count
            parts.append(f"@{quoted(leaf.name)}: {difference(state, count, saved)}")
    return "; ".join(parts)


def difference(state: State, count: int, saved: SavedSelection) -> str:
    """`evaluated again: 6 on b, generation 4; saved: 9 on a, generation 3`."""
    here = SavedSelection(
        "", state.generation, state.run, count, state.trajectories, with_trained=state.with_trained
    )
    populations = saved.with_trained != state.with_trained and bool(state.trained.any())
    here_text, saved_text = (
        summary(each) + (f", {_population(each)}" if populations else "") for each in (here, saved)
    )
    return f"evaluated again: {here_text}; saved: {saved_text}"


def describe_move(state: State, before: State, saved: SavedSelection) -> str:
    """The changes that a shared selection caused, and how its result differs from it."""
    parts = [state.message] if state.message else []
    if state.run != before.run:
        parts.append(f"run {state.run}")
    if state.trajectories != before.trajectories:
        parts.append(f"trajectories {', '.join(state.trajectories or ('all',))}")
    if state.with_trained != before.with_trained and state.trained.any():
        parts.append(state.population_message)
    count = int(np.count_nonzero(state.selected))
    if count != saved.count or not _is_same_place(state, saved):
        parts.append(difference(state, count, saved))
    return "; ".join(parts)


def summary(saved: SavedSelection) -> str:
    """`9 on vanilla, generation 3, in traj1`."""
    view = f", in {', '.join(saved.trajectories)}" if saved.trajectories else ""
    return f"{saved.count} on {saved.run}, generation {saved.generation}{view}"


def _is_same_place(state: State, saved: SavedSelection) -> bool:
    place = state.generation, state.run, state.trajectories
    is_same_population = saved.with_trained == state.with_trained or not state.trained.any()
    return is_same_population and place == (saved.generation, saved.run, saved.trajectories)


def _population(saved: SavedSelection) -> str:
    return "trained ones included" if saved.with_trained else "new ones only"
