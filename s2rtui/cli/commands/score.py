"""`s2r score`: score heatmaps and causes against the ground truth of the synthetic world."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rtui.cli.formatting.progress import reporter

EXAMPLE = "s2r score world.s2r --instances 48"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path, help="store of the synthetic world")
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
        help="views per run whose objects are restored, with --harm (default 200)")  # fmt: skip
    add("--seed", type=int, default=1, help="random seed that breaks ties (default 1)")
    add("--trust", action="store_true", help="allow model formats that execute code")
    add = parser.add_argument_group("output").add_argument
    add("--no-keep", action="store_true", help="do not save the score in the store")
    add("--json", action="store_true", help="print the result as JSON")
    add("--quiet", action="store_true", help="print no tables")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.scoring import report
    from s2rtui.cli.formatting import score_tables

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
        print("\n".join(score_tables.tables(scores)))
    return 0


def _check_writable(store: Path) -> None:
    """Raise RequestError, before the work begins, if the score cannot be saved in the store."""
    from s2rstore.index.transaction import check_writable

    s2rstore.open(store).close()
    try:
        check_writable(store)
    except RequestError as error:
        raise RequestError(f"{error}; use --no-keep to print the score only") from error
