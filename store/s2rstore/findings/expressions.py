"""Expressions that select exactly the instances of a finding."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import Node
from s2rstore.language.syntax_tree import And, Everything, Or, Training

Mask = NDArray[np.bool_]


def any_of(nodes: Iterable[Node]) -> Node:
    """The union of one or more expressions."""
    return reduce(Or, nodes)


def new_to(node: Node, own: Mask, others: Mapping[str, Mask]) -> Node:
    """Restrict an expression to the instances that are new to a run and to all `others`.

    `own` (N,) marks the instances new to the run, and `others` those new to runs by name. `new` is
    added for each of the others that excludes an instance that is new to the run.
    """
    for other, mask in others.items():
        if (own & ~mask).any():
            new = Training(False, other)
            node = new if node == Everything() else And(node, new)
    return node
