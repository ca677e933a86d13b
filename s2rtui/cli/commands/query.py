"""`s2r query`: list the instances that an expression selects."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.records import NO_RUN
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.output import print_coverage
from s2rtui.cli import scene_arguments
from s2rtui.cli.coverage_notes import print_left_out, print_missing_shares

if TYPE_CHECKING:
    from s2rstore.language import Query
    from s2rstore.reader import Store

EXAMPLE = "s2r query lab.s2r 'worst15 & room:right' --columns iid,room,real.error"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("expression", help="selection, for example 'worst15 & room:right - @done'")
    add = parser.add_argument_group("selection").add_argument
    add(
        "--run",
        help="run whose errors the expression refers to (default: the first that is computed; "
        "without one, expressions of the ground truth work)",
    )
    add("--trajectory", action="append", help="select from this trajectory only (repeatable)")
    scene_arguments.add_with_trained(add)
    add("--count", action="store_true", help="print only the number of instances")
    add("--columns", metavar="F,...",
        help="columns: fields of the selection language, tags and note; for example "
        "iid,room,real.outlier,tags")  # fmt: skip
    add("--with-expression", action="store_true",
        help="add the expression, run, generation and data set to the output")  # fmt: skip
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.language import evaluation
    from s2rtui.export.rows import selected_rows
    from s2rtui.user_data.notebook import ReadNotebook

    with s2rstore.open(options.store) as store:
        is_without_run = options.run is None and not store.has_computed_run
        run = NO_RUN if is_without_run else store.run_name(options.run)
        known = [trajectory.trajectory for trajectory in store.trajectories]
        for name in options.trajectory or ():
            if name not in known:
                trajectories = ", ".join(sorted(known))
                raise RequestError(f"--trajectory {name}: {options.store} has {trajectories}")
        notes = ReadNotebook(store.identity, parts=store.parts).notes
        print_coverage(store, [run])
        query = evaluation.query(
            store, options.expression, run, options.trajectory, notes.nodes, options.with_trained
        )
        evaluation.require_predictions(store, query)
        print_missing_shares(store, query)
        print_left_out(query)
        if options.count:
            print(int(query.instances.sum()))
            if query.trained.any() or query.unpaired.any():
                _print_count(query)
            _print_suggestions(store, query)
            return 0
        columns = options.columns.split(",") if options.columns else None
        selection = selected_rows(store, query, notes, columns)
        _print_suggestions(store, query)
    metadata = selection.facts if options.with_expression else None
    output.write(selection.names, selection.rows, options, metadata)
    if (
        query.trained.any()
        or query.unpaired.any()
        or (options.format == "table" and options.out is None)
    ):
        _print_count(query)
    return 0


def _print_count(query: Query) -> None:
    run = query.context.run
    print(f"{query.count_text} instances{f' of run {run}' if run else ''}", file=sys.stderr)


def _print_suggestions(store: Store, query: Query) -> None:
    """Print on standard error which wider expressions select something, where this one does not."""
    from s2rstore.language import widening

    if query.instances.any() or not store.has_poses or query.context.run == NO_RUN:
        return
    for wider in widening.widenings(query.node, query.context):
        print(f"nothing is selected; {wider.text} would give {wider.count}", file=sys.stderr)
