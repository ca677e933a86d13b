"""Tables of a report: accuracies with intervals and baseline, errors, tags and notes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import LEVEL_TEXT, Interval
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.export.report.report_model import ReportTable
from s2rtui.user_data.notebook import Notes

Members = NDArray[np.bool_]
_MAX_REMARKS = 40
_NOTE = (
    f"Accuracy with its {LEVEL_TEXT} interval. Baseline: accuracy of "
    "predicting the mean position of all instances that are new to the model. n is the number of "
    "instances that are new to the model; all others are left out."
)


def number(value: float | None, places: int = 2, unit: str = "") -> str:
    """Format a value with its unit: `7.60 m`, `6.1°`, or `n/a`."""
    if value is None or not math.isfinite(value):
        return "n/a"
    text = f"{value:.{places}f}".replace("-", "−")
    return text + ("" if unit in ("", "°") else " ") + unit


def percent(value: float) -> str:
    return number(100 * value, 1, "%")


def percent_interval(share: Interval) -> str:
    """Format a share with its interval: `98.0 % (97.6 to 98.3)`, or the reason for none."""
    if not math.isfinite(share.value):
        return "n/a"
    return f"{percent(share.value)} ({share.scaled(100).bounds_text('{:.1f}'.format)})"


def compared_runs(
    store: Store, runs: Sequence[str], members: Members | None, caption: str
) -> ReportTable:
    """Return one row per run over `members` (N,), or over all instances."""
    names = ("run", "sim accuracy", "real accuracy", "gap in points", "baseline",
             "sim median error", "real median error", "n")  # fmt: skip
    rows = []
    for run in runs:
        sim, real = (run_metrics.side_metrics(store, run, side, members) for side in SIDES)
        rows.append(
            (run, percent_interval(sim.accuracy), percent_interval(real.accuracy),
             number(100 * (sim.accuracy.value - real.accuracy.value), 1),
             percent(run_metrics.baseline_accuracy(store, run, members)),
             number(sim.median_error, 2, "m"), number(real.median_error, 2, "m"), str(sim.n))
        )  # fmt: skip
    return ReportTable(caption, names, rows, _NOTE)


def sides(store: Store, run: str, members: Members) -> ReportTable:
    """Return one row per side of a run over a selection."""
    names = ("", "accuracy", "baseline", "median error", "mean error", "largest error",
             "median heading error", "n")  # fmt: skip
    new = run_metrics.held_out(store, run) & members
    rows = []
    for side in SIDES:
        metrics = run_metrics.side_metrics(store, run, side, members)
        baseline = percent(run_metrics.baseline_accuracy(store, run, members, side))
        columns = store.run_columns(run).side(side)
        errors, turns = (
            column[new][np.isfinite(column[new])]
            for column in (columns.error, columns.heading_error)
        )
        largest = float(errors.max()) if errors.size else None
        turn = math.degrees(float(np.median(turns))) if turns.size else None
        rows.append(
            (side, percent_interval(metrics.accuracy), baseline,
             number(metrics.median_error, 2, "m"), number(metrics.mean_error, 2, "m"),
             number(largest, 2, "m"), number(turn, 1, "°"), str(metrics.n))
        )  # fmt: skip
    return ReportTable(f"Run {run} on the selection", names, rows)


def remarks(notes: Notes, members: Members) -> ReportTable | None:
    """Return the tags and notes of the selected instances; None if there are none."""
    rows = [
        (str(iid), " ".join(remark.tags), remark.note)
        for iid, remark in sorted(notes.remarks.items())
        if iid < members.size and members[iid]
    ]
    if not rows:
        return None
    more = len(rows) - _MAX_REMARKS
    note = f"and {more} more" if more > 0 else ""
    names = ("instance", "tags", "note")
    return ReportTable("Tags and notes", names, rows[:_MAX_REMARKS], note, True)
