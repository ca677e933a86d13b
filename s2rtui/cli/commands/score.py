"""`s2r score`: how far heatmaps and reasons are right, on a world whose truth is known."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument(
        "--run",
        action="append",
        default=[],
        help="only this run (repeat); the store keeps the score of all alone",
    )
    parser.add_argument("--instances", type=int, default=120,
                        help="of the counterfactual table (default 120)")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="breaks ties (default 1)")
    parser.add_argument("--no-keep", action="store_true", help="do not note the score in the store")
    parser.add_argument("--trust", action="store_true", help="allow models that execute code")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quiet", action="store_true", help="print no tables")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.scoring import report
    from s2rtui.cli.formatting.progress import reporter

    keeps = not options.no_keep and not options.run
    if keeps:
        _check_kept(options.store)
    settings = report.ScoreSettings(
        tuple(options.run), options.trust, options.instances, options.seed
    )
    with reporter() as told:
        found = report.score(options.store, settings, told)
    if keeps:
        report.save_report(options.store, found)
    if options.json:
        json.dump(found, sys.stdout, indent=1, sort_keys=True)
        print()
    elif not options.quiet:
        print("\n".join(_tables(found)))
    return 0


def _check_kept(store: Path) -> None:
    """Raises RequestError before the work where its result could not be kept."""
    import s2rstore
    from s2rstore.errors import RequestError
    from s2rstore.index.transaction import check_writable

    s2rstore.open(store).close()
    try:
        check_writable(store)
    except RequestError as error:
        raise RequestError(f"{error}; --no-keep scores without noting it") from error


def _tables(found: dict[str, Any]) -> list[str]:
    from s2rtui.cli.formatting import rows as output

    heat = [
        (r["run"], r["kind"], r["mode"], r["side"], r["place"], _of(r, "auroc"),
         _of(r, "precision"), _number(r["base_rate"]), r["n"], r["without"])
        for r in found["heatmaps"]
    ]  # fmt: skip
    factors = [
        (r["run"], r["factor"], _of(r, "alone"), _of(r, "cost"), _of(r, "without"),
         _of(r, "gain"), r["n"])
        for r in found["factors"]
    ]  # fmt: skip
    objects = [
        (r["run"], r["object"], r["name"], r["change"], _of(r, "gain"), r["n"])
        for r in found["objects"]
    ]
    parts = (
        ("Where heatmaps find the labelled changes",
         ("run", "heatmap", "mode", "side", "place", "AUROC", "precision of top 5 %", "base rate",
          "n", "frames without"), heat),
        ("Why reality is worse: mean position error, m",
         ("run", "factor", "alone", "costs", "all but it", "leaving it out gains", "n"), factors),
        ("What restoring one object gains where it is seen, m",
         ("run", "object", "name", "change", "gain", "n"), objects),
    )  # fmt: skip
    return [f"{title}\n\n{output.table(names, rows)}" for title, names, rows in parts]


def _of(row: dict[str, Any], name: str) -> str:
    low, high = (_number(row[f"{name}_{end}"]) for end in ("low", "high"))
    return f"{_number(row[name])} ({low} .. {high})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
