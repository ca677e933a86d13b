"""How the gap of a run changed between its first and its last measured night."""

from __future__ import annotations

import math
from pathlib import Path

from s2rstore.findings.finding import Finding, bounds_text
from s2rstore.gap_history import reader
from s2rstore.gap_history.reader import Night
from s2rstore.intervals import difference_of
from s2rstore.reader import Store


def gap_drift(store: Store, run: str, history: Path | None = None) -> Finding | None:
    """The change of G from the first to the last night that was measured and judged.

    `history` is a gap history, by default that of the store. The two nights count as independent,
    so that the half widths of their intervals add in squares. A measurement has the date of the
    night that made it, not of later nights that repeat its figures. None where fewer than two
    nights were measured. Raises RequestError for a file that is no history.
    """
    if history is None and (stored := store.gap_history()) is not None:
        history = stored[0]
    if history is None or reader.file_stamp(history) is None:
        return None
    nights = reader.read(history).of_run(run, store.dataset.name)
    judged = [night for night in nights if math.isfinite(night.gap.value)]
    by_measurement: dict[int, Night] = {}
    for night in judged:
        by_measurement.setdefault(night.measured, night)
    measured = list(by_measurement.values())
    if len(measured) < 2:
        return None
    first, last = measured[0], measured[-1]
    change = difference_of(last.gap, first.gap)
    evident = change.excludes_zero
    direction = "rose" if change.value > 0 else "fell"
    figures = f"by {abs(change.value):.1f} ({bounds_text(change, signed=True)})"
    span = f"from {first.night} to {last.night}, n {len(measured)} nights"
    text = f"G {direction} {figures} {span}"
    return Finding(
        kind="gap drift",
        text=text,
        run=run,
        n=len(measured),
        evidence=_worst_axis(last),
        evident=evident,
        values={
            "first_night": str(first.night),
            "last_night": str(last.night),
            "first_gap_percent": first.gap.value,
            "last_gap_percent": last.gap.value,
            "change_percent": change.value,
        },
        interval=change,
        interval_of="change_percent",
        n_of="nights",
        view="history",
    )


def _worst_axis(night: Night) -> str:
    if night.worst is None:
        return ""
    return f"worst axis of the last night: {night.worst}, G {night.gap.value:.1f}"
