"""Notes on standard error: populations of instances, and runs without shares of the gap."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from s2rstore.index.population import left_out_text
from s2rstore.reader import Store
from s2rtools.common.command_line.output import print_coverage

if TYPE_CHECKING:
    from s2rstore.language import Query
    from s2rtui.charts.scene import Scene


def print_notes(scene: Scene) -> None:
    """Print for how many instances the runs of a scene are computed where these are not all.

    Then how many instances are selected, where the run's model was trained on some.
    """
    from s2rtui.session.evaluation import query_of

    state = scene.state
    print_coverage(scene.store, (state.run, state.compared_run))
    if state.trained.any():
        print(f"{state.count_text} instances of run {state.run}", file=sys.stderr)
        print_left_out(query_of(scene.store, state, scene.notes))


def print_missing_shares(store: Store, query: Query) -> None:
    """Print a line for each run that has no shares of the gap, where an expression names them."""
    from s2rstore.metrics.gap_shares import has_shares

    named = (field for field in query.fields if field.name.startswith("share."))
    for name in sorted({field.run or query.context.run for field in named}):
        if name and not has_shares(store, name):
            command = f"`s2r precompute {store.path} --run {name} --kinds harm` computes them"
            print(f"run {name} has no shares of the gap; {command}", file=sys.stderr)


def print_left_out(query: Query) -> None:
    """Print how many trained instances an expression asks for that are left out."""
    if count := query.trained_left_out:
        print(left_out_text(count, "--with-trained includes them"), file=sys.stderr)
