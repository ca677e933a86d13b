"""What an expression is checked against, and saved selections put in their places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.language import fields
from s2rstore.language.errors import ExpressionError, unknown
from s2rstore.language.nodes import (
    And,
    Around,
    Between,
    Box,
    Compare,
    Extreme,
    Field,
    Lasso,
    Like,
    Minus,
    Named,
    Near,
    Node,
    Not,
    Or,
    Saved,
    leaves,
)
from s2rstore.records import SPLITS, Side


class Neighbours(Protocol):
    """Who is near whom in the embeddings of a run's side."""

    def __call__(
        self, run: str, side: Side, iid: int, count: int, trajectories: tuple[str, ...] | None
    ) -> NDArray[np.int64]:
        """The instance and its `count` nearest of the base population; RequestError if unknown."""
        ...


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that an expression may use; `saved` maps names to parsed selections."""

    runs: tuple[str, ...]
    rooms: tuple[str, ...]
    trajectories: tuple[str, ...]
    saved: Mapping[str, Node] = field(default_factory=dict)
    splits: tuple[str, ...] = SPLITS

    def of(self, name: str) -> tuple[str, ...]:
        """The known values of a text field's vocabulary."""
        return {"rooms": self.rooms, "trajectories": self.trajectories, "splits": self.splits}[name]


def expand(node: Node, words: Vocabulary, inside: tuple[str, ...] = ()) -> Node:
    """Check every name and replace saved selections by what they stand for.

    Raises ExpressionError for unknown names and for saved selections that contain themselves.
    """
    if isinstance(node, Not):
        return Not(expand(node.inner, words, inside))
    if isinstance(node, And | Minus | Or):
        return type(node)(expand(node.left, words, inside), expand(node.right, words, inside))
    if isinstance(node, Saved):
        if node.name not in words.saved:
            raise unknown(node.column, "saved selection", node.name, words.saved)
        if node.name in inside:
            raise ExpressionError(node.column, f"@{node.name} contains itself")
        return expand(words.saved[node.name], words, (*inside, node.name))
    for run in _runs(node):
        if run not in words.runs:
            raise unknown(1, "run", run, words.runs)
    if isinstance(node, Named):
        text = fields.TEXT[node.field.name]
        if node.value not in words.of(text.vocabulary):
            raise unknown(node.column, node.field.name, node.value, words.of(text.vocabulary))
    return node


def used_fields(node: Node) -> tuple[Field, ...]:
    """The fields that a leaf looks at."""
    if isinstance(node, Compare | Between | Around | Named | Extreme):
        return (node.field,)
    return (node.x, node.y) if isinstance(node, Box | Near | Lasso) else ()


def used_runs(node: Node) -> set[str]:
    """The runs that an expanded expression names."""
    return {run for leaf in leaves(node) for run in _runs(leaf)}


def _runs(leaf: Node) -> set[str]:
    named = [leaf.run] if isinstance(leaf, Like) else [f.run for f in used_fields(leaf)]
    return {run for run in named if run is not None}


def resolved(
    node: Like, run: str, trajectories: tuple[str, ...] | None, neighbours: Neighbours | None
) -> NDArray[np.int64]:
    """The instances that `like` means, where `run` is the current one.

    Raises ExpressionError where the run has no embeddings or the instance does not exist.
    """
    if neighbours is None:
        raise ExpressionError(node.column, "like needs a store with embeddings")
    try:
        return neighbours(node.run or run, node.side, node.iid, node.count, trajectories)
    except RequestError as error:
        raise ExpressionError(node.column, f"like: {error}") from error
