"""`s2r score`: score heatmaps and causes against the ground truth of the synthetic world."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError
from s2rtui.cli import store_argument
from s2rtui.cli.formatting.progress import reporter

EXAMPLE = "s2r score world.s2r --instances 48"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store of the synthetic world")
    add = parser.add_argument_group("scope").add_argument
    add("--run", action="append", default=[],
        help="score only this run (repeatable); the result is then not saved in the "
        "store")  # fmt: skip
    add("--instances", type=int, default=120,
        help="instances for the counterfactual tables (default 120)")  # fmt: skip
    add("--seed", type=int, default=1, help="random seed that breaks ties (default 1)")
    add("--trust", action="store_true", help="allow model formats that execute code")
    add = parser.add_argument_group("output").add_argument
    add("--no-keep", action="store_true", help="do not save the score in the store")
    add("--json", action="store_true", help="print the result as JSON")
    add("--quiet", action="store_true", help="print no tables")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.scoring import report

    saves = not options.no_keep and not options.run
    if saves:
        _check_writable(options.store)
    runs = tuple(options.run)
    settings = report.ScoreSettings(runs, options.trust, options.instances, options.seed)
    with reporter() as progress:
        scores = report.score(options.store, settings, progress)
    if saves:
        report.save_report(options.store, scores)
    if options.json:
        json.dump(scores, sys.stdout, indent=1, sort_keys=True)
        print()
    elif not options.quiet:
        print("\n".join(_tables(scores)))
    return 0


def _check_writable(store: Path) -> None:
    """Raise RequestError, before the work begins, if the score cannot be saved in the store."""
    from s2rstore.index.transaction import check_writable

    s2rstore.open(store).close()
    try:
        check_writable(store)
    except RequestError as error:
        raise RequestError(f"{error}; use --no-keep to print the score only") from error


def _tables(scores: dict[str, Any]) -> list[str]:
    from s2rtui.cli.formatting import rows as output

    heat = [
        (r["run"], r["kind"], r["mode"], r["side"], r["place"], _interval(r, "auroc"),
         _interval(r, "precision"), _number(r["base_rate"]), r["n"], r["without"])
        for r in scores["heatmaps"]
    ]  # fmt: skip
    factors = [
        (r["run"], r["factor"], _interval(r, "alone"), _interval(r, "cost"),
         _interval(r, "without"), _interval(r, "gain"), r["n"])
        for r in scores["factors"]
    ]  # fmt: skip
    objects = [
        (r["run"], r["object"], r["name"], r["change"], _interval(r, "gain"), r["n"])
        for r in scores["objects"]
    ]
    parts = (
        ("Agreement of heatmaps with the labelled changes",
         ("run", "heatmap", "mode", "side", "place", "AUROC", "precision of top 5 %", "base rate",
          "n", "frames without"), heat),
        ("Causes of the real error: mean position error, m",
         ("run", "factor", "alone", "costs", "all but it", "leaving it out gains", "n"), factors),
        ("Error reduction by restoring one object, in images that show it, m",
         ("run", "object", "name", "change", "gain", "n"), objects),
    )  # fmt: skip
    return [f"{title}\n\n{output.table(names, rows)}" for title, names, rows in parts]


def _interval(row: dict[str, Any], name: str) -> str:
    low, high = (_number(row[f"{name}_{end}"]) for end in ("low", "high"))
    return f"{_number(row[name])} ({low} .. {high})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
