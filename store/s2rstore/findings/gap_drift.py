"""How the gap of a run changed over its measured nights, by the alarm of the nightly."""

from __future__ import annotations

import math
from pathlib import Path

from s2rstore.findings.finding import Finding
from s2rstore.gap_history import reader
from s2rstore.gap_history.change_check import alarm_text, alarms_of, earlier_gaps
from s2rstore.gap_history.reader import Night
from s2rstore.reader import Store


def gap_drift(store: Store, run: str, history: Path | None = None) -> Finding | None:
    """The change of G of one axis since its first comparable measurement.

    The axis is one that has grown by the alarm of `s2r nightly`, else the worst one of the last
    night. Only the alarm makes the change evident; a decrease is not tested. `history` is a gap
    history, by default that of the store. A measurement has the date of the night that made it, not
    of later nights that repeat its figures. None where fewer than two measurements can be compared.
    Raises RequestError for a file that is no history.
    """
    if history is None and (stored := store.gap_history()) is not None:
        history = stored[0]
    if history is None or reader.file_stamp(history) is None:
        return None
    by_measurement: dict[int, Night] = {}
    for night in reader.read(history).of_run(run, store.dataset.name):
        if math.isfinite(night.gap.value):
            by_measurement.setdefault(night.measured, night)
    if len(by_measurement) < 2:
        return None
    *past, last = by_measurement.values()
    gaps = {
        each.axis: (each.gap.value, each.anchor)
        for each in last.axes
        if math.isfinite(each.gap.value) and math.isfinite(each.anchor)
    }
    of = last.dataset, last.run, last.expression
    alarms = alarms_of(past, of, gaps)
    grown = [axis for axis in alarms if alarms[axis].outcome == "FAIL"]
    axis = max(grown or gaps, key=lambda name: gaps[name][0], default=None)
    earlier = earlier_gaps(past, of, axis, gaps[axis][1]) if axis else {}
    if axis is None or not earlier:
        return None
    number, before = next(iter(earlier.items()))
    first, now, n = by_measurement[number], gaps[axis][0], len(earlier) + 1
    verb = "rose" if now > before else "fell"
    tested = alarm_text(axis, alarms[axis])
    return Finding(
        kind="gap drift",
        text=f"G of {axis} {verb} by {abs(now - before):.1f} to {now:.1f} from {first.night} to "
        f"{last.night}, n {n} nights",
        run=run,
        n=n,
        evidence=f"growth: {tested}",
        evident=bool(grown),
        values={
            "axis": axis,
            "first_night": str(first.night),
            "last_night": str(last.night),
            "first_gap_percent": before,
            "last_gap_percent": now,
            "change_percent": now - before,
        },
        n_of="nights",
        view="history",
    )
