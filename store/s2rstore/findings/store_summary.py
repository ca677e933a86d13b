"""Summarise a store in a few lines: its runs, and the findings about the first of them."""

from __future__ import annotations

from s2rstore.findings.report import find_all
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rstore.security.printable_text import printable


def summary_lines(store: Store) -> list[str]:
    """The summary, some of its lines long, for the end of a demo or a report."""
    computed = [name for name, run in store.runs.items() if run.key]
    if not computed:
        return ["no run is computed yet"]
    summary = [
        f"{len(store.instances)} instances, {len(computed)} runs; "
        f"predicting the mean position scores "
        f"{100 * run_metrics.baseline_accuracy(store, computed[0]):.1f} % accuracy"
    ]
    summary += [_run_line(store, name) for name in computed]
    for finding in find_all(store, computed[0]).findings:
        of_run = "" if finding.kind == "best run" else f" of {finding.run}"
        summary.append(f"{finding.kind}{of_run}: {finding.line}")
    return [printable(line) for line in summary]


def _run_line(store: Store, run: str) -> str:
    parts = []
    for side in SIDES:
        metrics = run_metrics.side_metrics(store, run, side)
        if not metrics.n:
            parts.append(f"{side} n/a (all {metrics.trained_on} trained on)")
            continue
        span = f"{100 * metrics.accuracy.low:.1f} .. {100 * metrics.accuracy.high:.1f}"
        left_out = f", {metrics.trained_on} trained on left out" if metrics.trained_on else ""
        parts.append(
            f"{side} {100 * metrics.accuracy.value:.1f} % ({span}), median "
            f"{metrics.median_error:.2f} m, n {metrics.n}{left_out}"
        )
    return f"  {run}: " + "; ".join(parts)
