"""Check the names of an expression and expand its saved selections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import DamagedStoreError, ExpressionError, RequestError, unknown
from s2rstore.index.population import Population
from s2rstore.language import fields
from s2rstore.language import syntax_tree as tree
from s2rstore.records import SPLITS, Side

MAX_TERMS = 1_000
"""Terms of an expression once its saved selections are expanded."""
MAX_LEVELS = 200
"""Nested levels of an expression once its saved selections are expanded."""


class Neighbours(Protocol):
    """Finds similar instances in the embeddings of one side of a run."""

    def __call__(
        self, run: str, side: Side, iid: int, count: int, population: Population
    ) -> NDArray[np.int64]:
        """The instance and its `count` nearest neighbours in the population.

        Raises RequestError for an unknown instance.
        """
        ...


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that an expression may use; `saved` maps names to parsed selections.

    `faults` is empty where no image has been checked.
    """

    runs: tuple[str, ...]
    rooms: tuple[str, ...]
    trajectories: tuple[str, ...]
    saved: Mapping[str, tree.Node] = field(default_factory=dict)
    domains: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    splits: tuple[str, ...] = SPLITS
    faults: tuple[str, ...] = ()

    def of(self, name: str) -> tuple[str, ...]:
        """The values that a text field can have, by the name of its vocabulary."""
        names: tuple[str, ...] = getattr(self, name)
        return names


def expand(node: tree.Node, words: Vocabulary) -> tree.Node:
    """Check every name and replace saved selections by their expressions.

    A saved selection is expanded once, however often it is named. Raises ExpressionError for
    unknown names, for saved selections that contain themselves, and where the result has more
    than `MAX_TERMS` terms or is nested deeper than `MAX_LEVELS`.
    """
    return _Expansion(words).expanded(node, 0).node


@dataclass(frozen=True, slots=True)
class _Expanded:
    """A node without saved selections, with its terms and its height.

    Height counts negations and right operands: a chain of operators, which is a left operand in a
    left operand, is evaluated in a loop.
    """

    node: tree.Node
    terms: int = 1
    height: int = 0


class _Expansion:
    """The expansion of one expression; `_saved` holds the expanded selection of each name."""

    def __init__(self, words: Vocabulary) -> None:
        self._words = words
        self._saved: dict[str, _Expanded] = {}
        self._open: list[tree.Saved] = []

    def expanded(self, node: tree.Node, level: int) -> _Expanded:
        """`level` is the number of operators that the node is the right operand of, or in."""
        if level > MAX_LEVELS:
            raise self._too_large(f"nested over {MAX_LEVELS} levels deep")
        first, links = tree.chain(node)
        result = self._operand(first, level)
        for link in links:
            right = self.expanded(link.right, level + 1)
            whole = _Expanded(
                type(link)(result.node, right.node),
                result.terms + right.terms,
                max(result.height, right.height + 1),
            )
            result = self._checked(whole, level)
        return result

    def _operand(self, node: tree.Node, level: int) -> _Expanded:
        if isinstance(node, tree.Saved):
            return self._of_name(node, level)
        if isinstance(node, tree.Not):
            inner = self.expanded(node.inner, level + 1)
            return self._checked(
                _Expanded(tree.Not(inner.node), inner.terms, inner.height + 1), level
            )
        _check_names(node, self._words)
        return self._checked(_Expanded(node), level)

    def _of_name(self, node: tree.Saved, level: int) -> _Expanded:
        if node.name not in self._words.saved:
            raise unknown(node.column, "saved selection", node.name, self._words.saved)
        if any(node.name == outer.name for outer in self._open):
            raise ExpressionError(node.column, f"@{node.name} contains itself")
        self._open.append(node)
        if node.name not in self._saved:
            self._saved[node.name] = self.expanded(self._words.saved[node.name], level + 1)
        result = self._checked(self._saved[node.name], level)
        self._open.pop()
        return result

    def _checked(self, expanded: _Expanded, level: int) -> _Expanded:
        """Return `expanded`; raise ExpressionError where it makes the expression too large."""
        if level + expanded.height > MAX_LEVELS:
            raise self._too_large(f"nested over {MAX_LEVELS} levels deep")
        if expanded.terms > MAX_TERMS:
            raise self._too_large(f"over {MAX_TERMS} terms long")
        return expanded

    def _too_large(self, what: str) -> ExpressionError:
        if not self._open:
            problem = f"the expression with its saved selections is {what}; shorten it"
            return ExpressionError(1, problem)
        first = self._open[0]
        problem = f"@{first.name} with the selections in it is {what}"
        return ExpressionError(first.column, f"{problem}; save a simpler selection under this name")


def _check_names(leaf: tree.Node, words: Vocabulary) -> None:
    for run in _runs(leaf):
        if run not in words.runs:
            raise unknown(1, "run", run, words.runs)
    if isinstance(leaf, tree.Named):
        text = fields.TEXT[leaf.field.name]
        if text.vocabulary == "faults" and not words.faults:
            raise ExpressionError(leaf.column, "no image has been checked; run `s2r check STORE`")
        if leaf.value not in words.of(text.vocabulary):
            kind = {"has": "domain", "health": "fault"}.get(leaf.field.name, leaf.field.name)
            raise unknown(leaf.column, kind, leaf.value, words.of(text.vocabulary))
    if isinstance(leaf, tree.LabelGain) and leaf.label not in words.labels:
        raise unknown(leaf.column, "label", leaf.label, words.labels)


def used_fields(node: tree.Node) -> tuple[tree.Field, ...]:
    """The fields that a leaf reads."""
    if isinstance(node, tree.Compare | tree.Between | tree.Around | tree.Named | tree.Extreme):
        return (node.field,)
    if isinstance(node, tree.Training):
        return (tree.Field("split", node.run),)
    if isinstance(node, tree.Bend):
        return (tree.Field("curvature"),)
    return (node.x, node.y) if isinstance(node, tree.Box | tree.Near | tree.Lasso) else ()


def uses_predictions(node: tree.Node) -> bool:
    """Whether what an expanded expression selects depends on the predictions of a run."""
    return any(
        isinstance(leaf, tree.Like | tree.LabelGain)
        or any(_is_of_predictions(each.name) for each in used_fields(leaf))
        for leaf in tree.leaves(node)
    )


def _is_of_predictions(name: str) -> bool:
    known = fields.NUMERIC.get(name) or fields.TEXT[name]
    return not (known.path == "iid" or known.path.startswith("instances.") or "split" in name)


def _runs(leaf: tree.Node) -> set[str]:
    named = (
        [leaf.run]
        if isinstance(leaf, tree.Like | tree.LabelGain | tree.Paired)
        else [f.run for f in used_fields(leaf)]
    )
    return {run for run in named if run is not None}


def similar_instances(
    node: tree.Like, run: str, population: Population, neighbours: Neighbours | None
) -> NDArray[np.int64]:
    """The instances that `like` selects, where `run` is the current run.

    Raises ExpressionError where the run has no embeddings or the instance does not exist,
    DamagedStoreError where the embeddings cannot be read.
    """
    if neighbours is None:
        raise ExpressionError(node.column, "like needs a store with embeddings")
    try:
        return neighbours(node.run or run, node.side, node.iid, node.count, population)
    except DamagedStoreError:
        raise
    except RequestError as error:
        raise ExpressionError(node.column, f"like: {error}") from error
