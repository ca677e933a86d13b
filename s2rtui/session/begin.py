"""Where a selection comes from: the first screen's finding, or two selections joined."""

from __future__ import annotations

from s2rstore import findings
from s2rstore.language import Node
from s2rstore.language.nodes import And, Everything, Extreme, Field, Minus, Named, Or
from s2rstore.reader import Store
from s2rtui.session.state import Operator


def finding(store: Store, run: str) -> tuple[Node, str]:
    """The first screen's selection, the room where reality is worst, and what it says."""
    rooms = findings.regions(store, run)
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
