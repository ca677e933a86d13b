"""Expressions that select exactly the instances of a finding."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import Node, evaluation, mask
from s2rstore.language.syntax_tree import And, Compare, Field, Minus, Named, Not, Or
from s2rstore.reader import Store
from s2rstore.records import SIDES, SPLITS


def any_of(nodes: Iterable[Node]) -> Node:
    """The union of one or more expressions."""
    return reduce(Or, nodes)


def exact(
    store: Store, run: str, node: Node, members: NDArray[np.bool_], runs: Sequence[str] = ()
) -> Node | None:
    """An expression that selects `members` (N,) in `run`; None where none is known.

    That is `node` where it selects them, else `node` without the instances that `run` or one of
    the other `runs` was trained on or has not predicted.
    """
    if _selects(store, run, node, members):
        return node
    excluded: list[Node] = []
    for name in dict.fromkeys((run, *runs)):
        of = None if name == run else name
        columns = store.run_columns(name)
        for side in SIDES:
            codes = columns.side(side).split
            excluded += [
                Named(Field(f"{side}.split", of), split)
                for split in ("train", "validation")
                if (codes == SPLITS.index(split)).any()
            ]
        if of is not None and not columns.valid.all():
            errors = (Compare(Field(f"{side}.error", of), ">=", 0.0) for side in SIDES)
            excluded.append(Not(And(*errors)))
    if not excluded:
        return None
    narrower = Minus(node, any_of(excluded))
    return narrower if _selects(store, run, narrower, members) else None


def _selects(store: Store, run: str, node: Node, members: NDArray[np.bool_]) -> bool:
    return np.array_equal(mask(node, evaluation.context(store, run)), members)
