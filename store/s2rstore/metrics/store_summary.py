"""Summarise a store in a few lines: runs, worst room, costliest factor, best heatmap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.metrics import heatmap_scores, run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rstore.security.printable_text import printable

MIN_INSTANCES = 5


@dataclass(frozen=True, slots=True)
class RoomSummary:
    """A room of one run: median errors in metres over `n` instances new to the model."""

    room: str
    n: int
    real_median: float
    sim_median: float


def worst_rooms(store: Store, run: str) -> list[RoomSummary]:
    """Rooms with at least five instances new to the model, the largest median real error first."""
    columns = store.run_columns(run)
    held_out = run_metrics.held_out(store, run)
    truth = store.instances
    summaries = []
    for code, name in enumerate(truth.room_names):
        members = held_out & (truth.room == code)
        n = int(members.sum())
        if n >= MIN_INSTANCES:
            real = float(np.median(columns.real.error[members]))
            sim = float(np.median(columns.sim.error[members]))
            summaries.append(RoomSummary(name, n, real, sim))
    return sorted(summaries, key=lambda region: -region.real_median)


def summary_lines(store: Store) -> list[str]:
    """The summary in a dozen lines, for the end of a demo or a log."""
    computed = [name for name, run in store.runs.items() if run.key]
    if not computed:
        return ["no run is computed yet"]
    summary = [
        f"{len(store.instances)} instances, {len(computed)} runs; "
        f"predicting the mean position scores "
        f"{100 * run_metrics.baseline_accuracy(store, computed[0]):.1f} % accuracy"
    ]
    summary += [_run_line(store, name) for name in computed]
    best = max(computed, key=lambda name: _accuracy(store, name))
    summary.append(f"best in reality: {best} ({100 * _accuracy(store, best):.1f} %)")
    rooms = worst_rooms(store, computed[0])
    if rooms:
        worst = rooms[0]
        summary.append(
            f"worst region of {computed[0]}: {worst.room} (median real error "
            f"{worst.real_median:.2f} m, sim {worst.sim_median:.2f} m; {worst.n} new instances)"
        )
    if "report" in store.provenance("score"):
        try:
            summary += _score_lines(store, store.score_report)
        except (RequestError, ValueError, TypeError, KeyError, AttributeError):
            summary.append("the stored score is invalid; run `s2r score` again")
    return [printable(line) for line in summary]


def _score_lines(store: Store, report: dict[str, Any]) -> list[str]:
    """The costliest factor and the best heatmap of the first run that a score report fits."""
    keys = report["runs"]
    runs = [name for name, run in store.runs.items() if run.key and run.key == keys.get(name)]
    if not runs:
        return []
    factors = [row for row in report["factors"] if row["run"] == runs[0]]
    return [*_cause_lines(runs[0], factors), *_heatmap_lines(store, runs[0])]


def _cause_lines(run: str, causes: list[dict[str, Any]]) -> list[str]:
    known = [row for row in causes if row["cost"] is not None]
    if not known:
        return []
    worst = max(known, key=lambda row: row["cost"])
    return [
        f"costliest factor of {run}: {worst['factor']}, alone +{worst['cost']:.2f} m "
        f"({worst['cost_low']:.2f} .. {worst['cost_high']:.2f}); leaving it out gains "
        f"{worst['gain']:.2f} m ({worst['gain_low']:.2f} .. {worst['gain_high']:.2f})"
    ]


def _heatmap_lines(store: Store, run: str) -> list[str]:
    scores = heatmap_scores.own_scores(store, run)
    if not scores:
        return []
    best = scores[0]
    others: dict[str, float] = {}
    for score in scores[1:]:
        if score.kind != best.kind:
            others.setdefault(score.kind, score.auroc.value)
    summary = [
        f"best heatmap of {run}: {best.kind} finds the changed objects on the floor at AUROC "
        f"{best.auroc.value:.2f} ({best.auroc.low:.2f} .. {best.auroc.high:.2f}); "
        f"{100 * best.precision:.0f} % of its top cells are right "
        f"(chance {100 * best.chance:.0f} %)"
    ]
    if others:
        summary.append("  beside it: " + ", ".join(f"{k} {v:.2f}" for k, v in others.items()))
    return summary


def _accuracy(store: Store, run: str) -> float:
    value = run_metrics.side_metrics(store, run, "real").accuracy.value
    return value if np.isfinite(value) else -1.0


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
