"""Summarise a store in a few lines: its runs, and the findings about one of them."""

from __future__ import annotations

from s2rstore.findings.finding import Finding
from s2rstore.findings.report import find_all
from s2rstore.metrics import run_metrics
from s2rstore.metrics.recall import side_recall
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
        *(finding_line(finding) for finding in find_all(store, computed[0]).findings),
    ]
    return [printable(line) for line in summary]


def store_line(store: Store, run: str) -> str:
    """Numbers of instances and computed runs, and the accuracy of the baseline of a run."""
    return (
        f"{len(store.instances)} instances, {sum(bool(r.key) for r in store.runs.values())} runs; "
        f"predicting the mean position scores "
        f"{100 * run_metrics.baseline_accuracy(store, run):.1f} % accuracy"
    )


def finding_line(finding: Finding) -> str:
    """A finding about a run in one line."""
    of_run = "" if finding.kind == "best run" else f" of {finding.run}"
    return f"{finding.kind}{of_run}: {finding.line}"


def _run_line(store: Store, run: str) -> str:
    parts = []
    for side in SIDES:
        found = side_recall(store, run, side)
        if not found.n:
            parts.append(f"{side} n/a (all {found.trained_on} trained on)")
            continue
        point, median = found.headline, found.position.bounds_text(to=" .. ")
        share = point.share.scaled(100)
        left_out = f", {found.trained_on} trained on left out" if found.trained_on else ""
        lost = f", {found.not_localised} not localised" if found.not_localised else ""
        accuracy = run_metrics.side_metrics(store, run, side).accuracy
        span = share.bounds_text("{:.0f}".format, to=" .. ")
        parts.append(
            f"{side} median {found.position_text} ({median}) and {found.heading_text}, recall "
            f"{share.value:.0f} % ({span}) at {point.name}, accuracy "
            f"{100 * accuracy.value:.1f} %, n {found.n}{lost}{left_out}"
        )
    return f"  {run}: " + "; ".join(parts)
