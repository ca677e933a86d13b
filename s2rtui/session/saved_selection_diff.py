"""Saved selections that are used elsewhere than where they were saved: what differs, in words."""

from __future__ import annotations

import numpy as np

from s2rstore.language import MaskContext, Node, mask
from s2rstore.language.canonical_text import quoted
from s2rstore.language.syntax_tree import Saved, leaves
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes, SavedSelection


def told(node: Node, state: State, context: MaskContext, notes: Notes) -> str:
    """How the saved names of an expression were evaluated anew; empty where nothing differs."""
    names = dict.fromkeys(leaf.name for leaf in leaves(node) if isinstance(leaf, Saved))
    return "; ".join(
        f"@{quoted(name)}: {differing(state, _count(name, context), notes.selections[name])}"
        for name in names
        if name in notes.selections and not _here(state, notes.selections[name])
    )


def differing(state: State, count: int, saved: SavedSelection) -> str:
    """`evaluated anew: 6 on b, generation 4; saved: 9 on a, generation 3`."""
    here = SavedSelection("", state.generation, state.run, count, state.trajectories)
    return f"evaluated anew: {where(here)}; saved: {where(saved)}"


def taken(state: State, before: State, saved: SavedSelection) -> str:
    """What moved with a selection that was shared with its facts, and how it differs from them."""
    told = [state.message] if state.message else []
    if state.run != before.run:
        told.append(f"run {state.run}")
    if state.trajectories != before.trajectories:
        told.append(f"trajectories {', '.join(state.trajectories or ('all',))}")
    count = int(np.count_nonzero(state.selected))
    own = state.generation, state.run, count, state.trajectories
    if own != (saved.generation, saved.run, saved.count, saved.trajectories):
        told.append(differing(state, count, saved))
    return "; ".join(told)


def where(saved: SavedSelection) -> str:
    """`9 on vanilla, generation 3, in traj1`."""
    view = f", in {', '.join(saved.trajectories)}" if saved.trajectories else ""
    return f"{saved.count} on {saved.run}, generation {saved.generation}{view}"


def _count(name: str, context: MaskContext) -> int:
    return int(np.count_nonzero(mask(Saved(name), context)))


def _here(state: State, saved: SavedSelection) -> bool:
    own = state.generation, state.run, state.trajectories
    return own == (saved.generation, saved.run, saved.trajectories)
