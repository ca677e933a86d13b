"""`s2r runs`: list the runs of a store with median errors, recall, accuracy and baseline."""

from __future__ import annotations

import argparse
import math
import sys
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.intervals import LEVEL_TEXT
from s2rstore.records import SIDES
from s2rstore.run_inputs import chain_text
from s2rtools.common.command_line import output, store_argument

if TYPE_CHECKING:
    from s2rstore.metrics.recall import SideRecall
    from s2rstore.metrics.run_metrics import SideMetrics

_LEADING = tuple(
    name
    for side in SIDES
    for name in (f"{side} median m", f"{side} median deg", f"{side} recall %",
                 f"{side} recall {LEVEL_TEXT}", f"{side} not localised")
)  # fmt: skip
_ACCURACIES = tuple(
    name for side in SIDES for name in (f"{side} accuracy %", f"{side} {LEVEL_TEXT}")
)
_NAMES = (
    "run", "model", "sim", "real", "n", "trained on", "recall at", *_LEADING, "sim skill",
    "real skill", *_ACCURACIES, "baseline %", "note",
)  # fmt: skip
EXAMPLE = "s2r runs lab.s2r --format csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    output.add_output_options(parser)


def execute(options: argparse.Namespace) -> int:
    from s2rstore.metrics import recall, run_metrics

    rows = []
    with s2rstore.open(options.store) as store:
        for run in store.runs.values():
            domains = [_domain_text(run.domain(s), run.adjustments(s)) for s in SIDES]
            if run.key is None:
                figures: list[object] = [None] * (len(_NAMES) - 5)
                note = "not computed: s2r precompute"
                if run.model in store.models and store.models[run.model].needs_trust:
                    note += " --trust (its model executes code)"
            else:
                found = [recall.side_recall(store, run.run, side) for side in SIDES]
                sides = [run_metrics.side_metrics(store, run.run, side) for side in SIDES]
                baseline = round(100 * run_metrics.baseline_accuracy(store, run.run), 1)
                n = found[0].n
                figures = [
                    n, found[0].trained_on, found[0].headline.name,
                    *(figure for side in found for figure in _leading(side)),
                    *(_rounded(side.skill.value, 2) for side in found),
                    *(figure for side in sides for figure in _accuracy(side)),
                    baseline if sides[0].n else None,
                ]  # fmt: skip
                note = store.coverage(run.run).summary
                if not n:
                    note = note or "trained on every instance"
                elif not run_metrics.knows_training_set(store, run.run):
                    note = note or "training set unknown"
            rows.append((run.run, run.model, *domains, *figures, note))
        missing = "" if store.runs else store.no_run
    output.write(_NAMES, rows, options)
    if missing:
        print(missing, file=sys.stderr)
    return 0


def _leading(found: SideRecall) -> list[object]:
    """Median errors (metres, degrees), recall (percent) with its interval, not localised."""
    if found.n < 2:
        return [None] * 5
    share = found.headline.share.scaled(100)
    medians = found.position, found.heading.scaled(180 / math.pi)
    return [
        *(_rounded(m.value, places) for m, places in zip(medians, (3, 1), strict=True)),
        round(share.value, 1), share.bounds_text("{:.1f}".format, to=".."), found.not_localised,
    ]  # fmt: skip


def _rounded(value: float, places: int) -> object:
    """The number, `not localised` in place of an infinite median, None without a figure."""
    if math.isinf(value):
        return "not localised"
    return None if math.isnan(value) else round(value, places)


def _accuracy(metrics: SideMetrics) -> list[object]:
    """Accuracy (percent) and its interval."""
    if metrics.n < 2:
        return [None, None]
    interval = metrics.accuracy.scaled(100).bounds_text("{:.1f}".format, to="..")
    return [round(100 * metrics.accuracy.value, 1), interval]


def _domain_text(domain: str, chain: list[dict[str, object]]) -> str:
    return f"{domain} ({chain_text(chain)})" if chain else domain
