"""Tables of a report: errors, recall, accuracies with intervals and baseline, tags and notes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import LEVEL_TEXT, Interval
from s2rstore.metrics import run_metrics
from s2rstore.metrics.recall import (
    NOT_LOCALISED,
    headline_index,
    side_recall,
    threshold_name,
)
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.export.report.report_model import ReportTable
from s2rtui.user_data.notebook import Notes

Members = NDArray[np.bool_]
_MAX_REMARKS = 40
_NOTE = (
    f"Recall and accuracy with their {LEVEL_TEXT} intervals. Recall: share of instances within "
    "both thresholds; instances that a run did not localise are failures. Baseline: accuracy of "
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


def _metres(median: Interval) -> str:
    """Format a median error in metres, or that it is not localised."""
    return NOT_LOCALISED if math.isinf(median.value) else number(median.value, 2, "m")


def _degrees(median: Interval) -> str:
    """Format a median heading error, given in radians, or that it is not localised."""
    value = math.degrees(median.value)
    return NOT_LOCALISED if math.isinf(value) else number(value, 1, "°")


def _headline_name(store: Store) -> str:
    """The thresholds of the recall that tables show."""
    pairs = store.dataset.recall_thresholds
    return threshold_name(*pairs[headline_index(len(pairs))])


def compared_runs(
    store: Store, runs: Sequence[str], members: Members | None, caption: str
) -> ReportTable:
    """Return one row per run over `members` (N,), or over all instances."""
    at = _headline_name(store)
    names = ("run", "sim median error", "real median error", "sim median heading error",
             "real median heading error", f"sim recall ({at})", f"real recall ({at})",
             "sim accuracy", "real accuracy", "gap in points", "baseline", "n",
             "not localised")  # fmt: skip
    rows = []
    for run in runs:
        found = [side_recall(store, run, side, members) for side in SIDES]
        sim, real = (run_metrics.side_metrics(store, run, side, members) for side in SIDES)
        rows.append(
            (run, *(_metres(side.position) for side in found),
             *(_degrees(side.heading) for side in found),
             *(percent_interval(side.headline.share) for side in found),
             percent_interval(sim.accuracy), percent_interval(real.accuracy),
             number(100 * (sim.accuracy.value - real.accuracy.value), 1),
             percent(run_metrics.baseline_accuracy(store, run, members)), str(found[0].n),
             ", ".join(f"{name} {side.not_localised}" for name, side in zip(SIDES, found,
                                                                            strict=True)))
        )  # fmt: skip
    return ReportTable(caption, names, rows, _NOTE)


def sides(store: Store, run: str, members: Members) -> ReportTable:
    """Return one row per side of a run over a selection."""
    names = ("", "median error", "median heading error", f"recall ({_headline_name(store)})",
             "skill", "accuracy", "baseline", "mean error", "largest error", "n",
             "not localised")  # fmt: skip
    new = run_metrics.population(store, run) & members
    rows = []
    for side in SIDES:
        metrics = run_metrics.side_metrics(store, run, side, members)
        baseline = percent(run_metrics.baseline_accuracy(store, run, members, side))
        found = side_recall(store, run, side, members)
        errors = store.run_columns(run).side(side).error[new]
        largest = float(errors.max()) if errors.size else None
        rows.append(
            (side, _metres(found.position), _degrees(found.heading),
             percent_interval(found.headline.share), number(found.skill.value, 2),
             percent_interval(metrics.accuracy), baseline, number(metrics.mean_error, 2, "m"),
             number(largest, 2, "m"), str(found.n), str(found.not_localised))
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
