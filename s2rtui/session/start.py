"""How a session begins, and where selections come from: a finding, or two selections joined."""

from __future__ import annotations

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.language import Node
from s2rstore.language.syntax_tree import And, Everything, Extreme, Field, Minus, Named, Or
from s2rstore.metrics import store_summary
from s2rstore.reader import Store
from s2rtui.session.generations import computed
from s2rtui.session.state import HistoryFile, Operator, State


def empty(store: Store, run: str | None, nights: HistoryFile | None) -> State:
    """A state on a run (default: the first computed one) before anything is selected.

    Raises RequestError for a run that is not there, or not computed.
    """
    chosen = store.run(run)
    if chosen.key is None:
        raise RequestError(f"run {chosen.run!r}: not computed yet; run `s2r precompute`")
    everything = np.ones(len(store.instances), dtype=np.bool_)
    return State(
        generation=store.generation,
        newest=store.generation,
        runs=computed(store),
        run=chosen.run,
        trajectories=None,
        expression="all",
        selected=everything,
        base=everything,
        cursor=None,
        heat=None,
        history=nights,
    )


def finding(store: Store, run: str) -> tuple[Node, str]:
    """The first screen's selection, the room where reality is worst, and what it says."""
    rooms = store_summary.worst_rooms(store, run)
    if not rooms:
        return Extreme("worst", 15, True, Field("real.error")), "the worst 15 % in reality"
    worst = rooms[0]
    return Named(Field("room"), worst.room), (
        f"worst region: {worst.room}, {worst.real_median:.2f} m real, "
        f"{worst.sim_median:.2f} m sim (medians of {worst.n} unseen)"
    )


def joined(current: Node, operator: Operator, new: Node) -> Node:
    """Two selections as one, in its shortest form."""
    if operator == "replace" or (operator == "intersect" and current == Everything()):
        return new
    if operator == "intersect":
        return And(current, new)
    return Or(current, new) if operator == "union" else Minus(current, new)
