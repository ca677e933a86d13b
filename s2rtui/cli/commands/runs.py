"""`s2r runs`: list the runs of a store with accuracies, errors and the constant baseline."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.intervals import LEVEL_TEXT
from s2rstore.records import SIDES
from s2rstore.run_inputs import chain_text
from s2rtui.cli import store_argument
from s2rtui.cli.formatting import rows as output

if TYPE_CHECKING:
    from s2rstore.metrics.run_metrics import SideMetrics

_NAMES = (
    "run", "model", "sim", "real", "n", "trained on", "sim accuracy %", f"sim {LEVEL_TEXT}",
    "sim median m", "real accuracy %", f"real {LEVEL_TEXT}", "real median m", "baseline %", "note",
)  # fmt: skip
EXAMPLE = "s2r runs lab.s2r --format csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.metrics import run_metrics

    rows = []
    with s2rstore.open(options.store) as store:
        for run in store.runs.values():
            domains = [_domain_text(run.domain(s), run.adjustments(s)) for s in SIDES]
            if run.key is None:
                figures: list[object] = [None] * 9
                note = "not computed: s2r precompute"
                if run.model in store.models and store.models[run.model].needs_trust:
                    note += " --trust (its model executes code)"
            else:
                sides = [run_metrics.side_metrics(store, run.run, side) for side in SIDES]
                baseline = round(100 * run_metrics.baseline_accuracy(store, run.run), 1)
                figures = [sides[0].n, sides[0].trained_on, *_side(sides[0]), *_side(sides[1]),
                           baseline if sides[0].n else None]  # fmt: skip
                note = store.coverage(run.run).summary
                if not sides[0].n:
                    note = note or "trained on every instance"
                elif not run_metrics.knows_training_set(store, run.run):
                    note = note or "training set unknown"
            rows.append((run.run, run.model, *domains, *figures, note))
        missing = "" if store.runs else store.no_run
    output.write(_NAMES, rows, options)
    if missing:
        print(missing, file=sys.stderr)
    return 0


def _side(metrics: SideMetrics) -> list[object]:
    """Return accuracy (percent), its interval and the median error (metres)."""
    if metrics.n < 2:
        return [None, None, None]
    accuracy = metrics.accuracy
    interval = accuracy.scaled(100).bounds_text("{:.1f}".format, to="..")
    return [round(100 * accuracy.value, 1), interval, round(metrics.median_error, 3)]


def _domain_text(domain: str, chain: list[dict[str, object]]) -> str:
    return f"{domain} ({chain_text(chain)})" if chain else domain
