"""`s2r score`: score heatmaps and causes against the ground truth of the synthetic world.

Image repairs need no ground truth, so they score the heatmaps of any store.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import reporter
from s2rtools.scoring import tables

EXAMPLE = "s2r score world.s2r --instances 48"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "store",
        type=store_argument.folder,
        help="store of the synthetic world; any store with --image-repairs",
    )
    add = parser.add_argument_group("scope").add_argument
    add("--run", action="append", default=[],
        help="score only this run (repeatable); the result is then not saved in the "
        "store")  # fmt: skip
    add("--instances", type=int, default=120,
        help="instances for the counterfactual tables (default 120)")  # fmt: skip
    add("--harm", action="store_true",
        help="also score what harms the pose: every heatmap kind against the gain of restoring "
        "each visible object, repair curves, and the shares of the gap (minutes)")  # fmt: skip
    add("--views", type=int, default=200,
        help="views per run, with --harm or --image-repairs (default 200)")  # fmt: skip
    add("--image-repairs", action="store_true",
        help="on any data: only print how much the error falls where cells of the real images "
        "show sim content instead, in the order of each heatmap")  # fmt: skip
    add("--seed", type=int, default=1, help="random seed that breaks ties (default 1)")
    add("--trust", action="store_true", help="allow model formats that execute code")
    add = parser.add_argument_group("output").add_argument
    add("--no-keep", action="store_true", help="do not save the score in the store")
    add("--json", action="store_true", help="print the result as JSON")
    add("--quiet", action="store_true", help="print no tables")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.scoring import report

    if options.image_repairs:
        return _print_image_repairs(options)
    saves = not options.no_keep and not options.run
    if saves:
        _check_writable(options.store)
    runs = tuple(options.run)
    settings = report.ScoreSettings(
        runs, options.trust, options.instances, options.seed, options.harm, options.views
    )
    with reporter() as progress:
        scores = report.score(options.store, settings, progress)
    if saves:
        report.save_report(options.store, scores)
    if options.json:
        json.dump(scores, sys.stdout, indent=1, sort_keys=True)
        print()
    elif not options.quiet:
        print("\n".join(tables.tables(scores)))
    return 0


def _print_image_repairs(options: argparse.Namespace) -> int:
    from s2rtools.scoring.image_repairs import score_image_repairs
    from s2rtools.scoring.report import computed_runs, json_row

    with s2rstore.open(options.store) as store, reporter() as progress:
        runs = computed_runs(store, tuple(options.run))
        progress.begin("image repairs", len(runs))
        rows = score_image_repairs(
            store, runs, options.views, options.seed, options.trust, progress.advance
        )
    found = [json_row(row) for row in rows]
    if options.json:
        json.dump(found, sys.stdout, indent=1, sort_keys=True)
        print()
    elif not options.quiet:
        print(tables.image_repairs(found))
    return 0


def _check_writable(store: Path) -> None:
    """Raise RequestError, before the work begins, if the score cannot be saved in the store."""
    from s2rstore.index.transaction import check_writable

    s2rstore.open(store).close()
    try:
        check_writable(store)
    except RequestError as error:
        raise RequestError(f"{error}; use --no-keep to print the score only") from error
