"""Figures of runs as tables: accuracies with their intervals beside the baseline, errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics import bootstrap, run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.export.report.content import ReportTable
from s2rtui.user_data.notebook import Notes

Members = NDArray[np.bool_]
_MOST_REMARKS = 40
BASELINE = "Baseline: predicting the mean position of all instances that are new to the model."


def number(value: float | None, places: int = 2, unit: str = "") -> str:
    """`7.60 m`, `6.1°`, or `n/a`."""
    if value is None or not math.isfinite(value):
        return "n/a"
    text = f"{value:.{places}f}".replace("-", "−")
    return text + ("" if unit in ("", "°") else " ") + unit


def percent(value: float) -> str:
    return number(100 * value, 1, "%")


def interval(found: bootstrap.Interval) -> str:
    """`98.0 % (97.6 to 98.3)`."""
    if not math.isfinite(found.value):
        return "n/a"
    ends = f"{100 * found.low:.1f} to {100 * found.high:.1f}"
    return percent(found.value) + (f" ({ends})" if math.isfinite(found.low) else "")


def compared(
    store: Store, runs: Sequence[str], members: Members | None, caption: str
) -> ReportTable:
    """A row per run, over `members` (N,) or all."""
    names = ("run", "sim accuracy", "real accuracy", "gap in points", "baseline",
             "sim median error", "real median error", "n")  # fmt: skip
    rows = []
    for run in runs:
        sim, real = (run_metrics.headline(store, run, side, members) for side in SIDES)
        rows.append(
            (run, interval(sim.accuracy), interval(real.accuracy),
             number(100 * (sim.accuracy.value - real.accuracy.value), 1),
             percent(run_metrics.baseline(store, run, members)),
             number(sim.median_error, 2, "m"), number(real.median_error, 2, "m"), str(sim.n))
        )  # fmt: skip
    level = bootstrap.LEVEL_TEXT
    note = f"Accuracy with its {level} block bootstrap interval. {BASELINE} {_left_out()}"
    return ReportTable(caption, names, rows, note)


def _left_out() -> str:
    return "n counts the instances that are new to the model; all others are left out."


def sides(store: Store, run: str, members: Members) -> ReportTable:
    """Both sides of a run over a selection."""
    names = ("", "accuracy", "baseline", "median error", "mean error", "largest error",
             "median heading error", "n")  # fmt: skip
    fresh = run_metrics.held_out(store, run) & members
    chance = percent(run_metrics.baseline(store, run, members))
    rows = []
    for side in SIDES:
        found = run_metrics.headline(store, run, side, members)
        rows.append(
            (side, interval(found.accuracy), chance, number(found.median_error, 2, "m"),
             number(found.mean_error, 2, "m"), number(_largest(store, run, side, fresh), 2, "m"),
             number(_median_turn(store, run, side, fresh), 1, "°"), str(found.n))
        )  # fmt: skip
    return ReportTable(f"Run {run} on the selection", names, rows)


def _largest(store: Store, run: str, side: Side, members: Members) -> float:
    errors = store.run_columns(run).side(side).error[members]
    return float(np.nanmax(errors)) if np.isfinite(errors).any() else math.nan


def _median_turn(store: Store, run: str, side: Side, members: Members) -> float:
    turns = store.run_columns(run).side(side).heading_error[members]
    turns = turns[np.isfinite(turns)]
    return math.degrees(float(np.median(turns))) if turns.size else math.nan


def remarks(notes: Notes, members: Members) -> ReportTable | None:
    """The user's tags and notes on a selection's instances; None where there is none."""
    found = [
        (iid, remark)
        for iid, remark in sorted(notes.remarks.items())
        if iid < members.size and members[iid]
    ]
    if not found:
        return None
    shown = [
        (str(iid), " ".join(remark.tags), remark.note) for iid, remark in found[:_MOST_REMARKS]
    ]
    more = len(found) - len(shown)
    told = f"and {more} more" if more else ""
    return ReportTable("Tags and notes", ("instance", "tags", "note"), shown, told, True)
