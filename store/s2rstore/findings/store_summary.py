"""Summarise a store in a few lines: its runs, and the findings about one of them."""

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
        store_line(store, computed[0]),
        *(_run_line(store, name) for name in computed),
        *finding_lines(store, computed[0]),
    ]
    return [printable(line) for line in summary]


def store_line(store: Store, run: str) -> str:
    """Numbers of instances and computed runs, and the accuracy of the baseline of a run."""
    return (
        f"{len(store.instances)} instances, {sum(bool(r.key) for r in store.runs.values())} runs; "
        f"predicting the mean position scores "
        f"{100 * run_metrics.baseline_accuracy(store, run):.1f} % accuracy"
    )


def finding_lines(store: Store, run: str) -> list[str]:
    """The findings about a computed run, one per line."""
    lines = []
    for finding in find_all(store, run).findings:
        of_run = "" if finding.kind == "best run" else f" of {finding.run}"
        lines.append(f"{finding.kind}{of_run}: {finding.line}")
    return lines


def _run_line(store: Store, run: str) -> str:
    parts = []
    for side in SIDES:
        metrics = run_metrics.side_metrics(store, run, side)
        if not metrics.n:
            parts.append(f"{side} n/a (all {metrics.trained_on} trained on)")
            continue
        span = metrics.accuracy.scaled(100).bounds_text("{:.1f}".format, to=" .. ")
        left_out = f", {metrics.trained_on} trained on left out" if metrics.trained_on else ""
        parts.append(
            f"{side} {100 * metrics.accuracy.value:.1f} % ({span}), median "
            f"{metrics.median_error:.2f} m, n {metrics.n}{left_out}"
        )
    return f"  {run}: " + "; ".join(parts)
