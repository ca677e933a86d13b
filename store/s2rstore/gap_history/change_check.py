"""Whether the gap has grown over the nights of a history, axis by axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from s2rstore.gap_history.gate_status import worst_outcome
from s2rstore.gap_history.reader import Night
from s2rstore.intervals import LEVEL
from s2rstore.intervals.sequential import BASELINE, YEAR, ChangeAlarm, change_alarm
from s2rstore.intervals.verdict import Outcome

CHANGE = 5.0
"""Growth of G, in percent of the anchor, that the alarm is tuned to."""
YEAR_LEVEL = 1 - (1 - LEVEL) / (4 * YEAR)
"""Level at which an axis or the golden run of one night fails.

A quarter of the year's false alarms is for the axes, a quarter for the golden run, and half for the
growth of G.
"""


@dataclass(frozen=True, slots=True)
class Change:
    """The outcome of the growth of G over the nights, and the reason in words."""

    outcome: Outcome
    reason: str


def change_of(
    past: Sequence[Night], dataset: str, run: str, expression: str,
    gaps: Mapping[str, tuple[float, float]],
) -> Change | None:  # fmt: skip
    """The change of the axes of a new night after the `past` ones, by name their G and anchor.

    None where no axis is judged.
    """
    alarms = alarms_of(past, (dataset, run, expression), gaps)
    if not alarms:
        return None
    outcome = worst_outcome(alarm.outcome for alarm in alarms.values())
    return Change(outcome, "; ".join(alarm_text(axis, alarm) for axis, alarm in alarms.items()))


def alarms_of(
    past: Sequence[Night], of: tuple[str, str, str], gaps: Mapping[str, tuple[float, float]]
) -> dict[str, ChangeAlarm]:
    """The alarm of each axis of a new night, by name its G and anchor, after the `past` nights.

    `of` is dataset, run and expression. Nights count where they measured the same and have the same
    anchor of the axis; a measurement that several nights repeat counts once. The axes share the
    budget of false alarms.
    """
    return {
        axis: change_alarm(
            np.array([*earlier_gaps(past, of, axis, anchor).values(), gap]),
            CHANGE, budget=(1 - LEVEL) / 2 / len(gaps),
        )
        for axis, (gap, anchor) in gaps.items()
    }  # fmt: skip


def earlier_gaps(
    past: Sequence[Night], of: tuple[str, str, str], axis: str, anchor: float
) -> dict[int, float]:
    """G of one axis in comparable measurements by their numbers, in the order of the nights."""
    found: dict[int, float] = {}
    for night in past:
        if (night.dataset, night.run, night.expression) != of:
            continue
        for figures in night.axes:
            if figures.axis == axis and np.isclose(figures.anchor, anchor, rtol=1e-6):
                found.setdefault(night.measured, figures.gap.value)
    return found


def alarm_text(axis: str, alarm: ChangeAlarm) -> str:
    """`task: no growth over G 20.1 of the first 30`."""
    if alarm.outcome == "INCONCLUSIVE":
        return f"{axis}: {alarm.n} of {BASELINE + 1} measurements"
    if alarm.outcome == "PASS":
        return f"{axis}: no growth over G {alarm.baseline:.1f} of the first {BASELINE}"
    assert alarm.since is not None
    return (
        f"{axis}: grown since measurement {alarm.since + 1} of {alarm.n} over G "
        f"{alarm.baseline:.1f} of the first {BASELINE}"
    )
