"""Notes on standard error: populations of instances, and runs without shares of the gap."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from s2rstore.index.population import left_out_text
from s2rstore.reader import Store

if TYPE_CHECKING:
    from s2rstore.language import Node
    from s2rtui.charts.scene import Scene


def print_population(scene: Scene) -> None:
    """Print how many instances are selected, where the run's model was trained on some."""
    state = scene.state
    if state.trained.any():
        print(f"{state.count} instances of run {state.run}", file=sys.stderr)
        print_left_out(
            scene.store, state.expression, state.run, state.trajectories, scene.notes.nodes,
            state.with_trained,
        )  # fmt: skip


def print_missing_shares(
    store: Store, expression: str, run: str, saved: Mapping[str, Node]
) -> None:
    """Print a line for each run that has no shares of the gap, where an expression names them."""
    from s2rstore.language import parse
    from s2rstore.language.evaluation import named_fields
    from s2rstore.metrics.gap_shares import has_shares

    fields = named_fields(parse(expression), store, saved)
    for name in sorted({field.run or run for field in fields if field.name.startswith("share.")}):
        if name and not has_shares(store, name):
            command = f"`s2r precompute {store.path} --run {name} --kinds harm` computes them"
            print(f"run {name} has no shares of the gap; {command}", file=sys.stderr)


def print_left_out(
    store: Store,
    expression: str,
    run: str,
    trajectories: Sequence[str] | None,
    saved: Mapping[str, Node],
    with_trained: bool,
) -> None:
    """Print how many trained instances an expression asks for that are left out."""
    from s2rstore.language import evaluation, mask, parse

    if with_trained or not store.run_columns(run).trained.any():
        return
    context = evaluation.context(store, run, trajectories, saved, with_trained)
    node = parse(expression)
    if count := evaluation.trained_left_out(node, context, mask(node, context)):
        print(left_out_text(count, "--with-trained includes them"), file=sys.stderr)
