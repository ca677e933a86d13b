"""One expression on the instances of a run, expanded once and evaluated once by dense masks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from s2rstore.index.population import count_text, unpaired_text
from s2rstore.language.name_resolution import expand, used_fields
from s2rstore.language.numpy_backend import Mask, MaskContext, mask, unpaired_mask
from s2rstore.language.syntax_tree import Field, Named, Node, Training, leaves
from s2rstore.records import TRAINING_SPLITS


@dataclass(frozen=True, eq=False)
class Query:
    """What an expression selects among the instances that count in `context`.

    `evaluation.query` makes one on a store. Every property raises ExpressionError, a RequestError
    that names the column, for names that `context` does not know.
    """

    node: Node
    context: MaskContext

    @cached_property
    def expanded(self) -> Node:
        """The expression with saved selections in place of their names."""
        return expand(self.node, self.context.words)

    @cached_property
    def fields(self) -> frozenset[Field]:
        """The fields that the expression and the saved selections in it read."""
        return frozenset(field for leaf in leaves(self.expanded) for field in used_fields(leaf))

    @cached_property
    def selected(self) -> Mask:
        """(N,) the selected instances of the base population, which figures are about."""
        return mask(self.expanded, self.context)

    @cached_property
    def unpaired(self) -> Mask:
        """(N,) the selected instances that lack an image of a side, which enter no figure."""
        return unpaired_mask(self.expanded, self.context)

    @property
    def instances(self) -> Mask:
        """(N,) all selected instances."""
        return self.selected | self.unpaired

    @cached_property
    def count(self) -> int:
        """The number of instances in `selected`."""
        return int(np.count_nonzero(self.selected))

    @cached_property
    def in_view(self) -> Mask:
        """(N,) the valid instances of the trajectories in view, with the trained ones."""
        context = self.context
        return context.population.in_view(context.instances, context.run_columns(context.run))

    @cached_property
    def trained(self) -> Mask:
        """(N,) the instances in view that the run's model was trained on."""
        return self.in_view & self.context.run_columns(self.context.run).trained

    @property
    def count_text(self) -> str:
        """`8 of 40 (32 trained on), 9 sim only`; see `s2rstore.index.population.count_text`."""
        in_view, trained = np.count_nonzero(self.in_view), np.count_nonzero(self.trained)
        with_trained = self.context.population.with_trained
        return count_text(self.count, int(in_view), int(trained), with_trained, self.unpaired_text)

    @property
    def unpaired_text(self) -> str:
        """`9 sim only`: how many instances `unpaired` has, by their images; empty without any."""
        return unpaired_text(self.unpaired, self.context.run_columns(self.context.run))

    @cached_property
    def trained_left_out(self) -> int:
        """How many trained instances the expression selects beyond `selected`.

        0 where the population includes them, and for expressions that select new instances and
        name no split of training images.
        """
        context = self.context
        columns = context.run_columns(context.run)
        if context.population.with_trained or not columns.trained.any():
            return 0
        if self.count and not any(map(_names_trained, leaves(self.expanded))):
            return 0
        included = replace(context, population=replace(context.population, with_trained=True))
        return int(np.count_nonzero(mask(self.expanded, included) & columns.trained))


def _names_trained(leaf: Node) -> bool:
    """Whether a leaf asks for instances that a model was trained on."""
    if isinstance(leaf, Named):
        return leaf.field.name.endswith("split") and leaf.value in TRAINING_SPLITS
    return isinstance(leaf, Training) and leaf.trained
