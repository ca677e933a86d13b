"""Build the nights of a gap history in memory."""

import datetime
import math
from collections.abc import Mapping
from typing import Any

from s2rstore.gap_history.gate_status import EXIT_CODES, axis_status
from s2rstore.gap_history.reader import AxisFigures, History, Night
from s2rstore.intervals import Interval

FIRST = datetime.date(2026, 11, 16)
UNKNOWN = Interval.unknown()


def night(number: int, gaps: Mapping[str, float], half_width: float = 2.0, **changes: Any) -> Night:
    """Night `number` (from 1) whose axes have these gaps G +- `half_width`; NaN is not judged."""
    axes = tuple(
        AxisFigures(name, "measured", name, "m", Interval(0.1, 0.2, 0.3), Interval(0.1, 0.1, 0.1),
                    Interval(gap - half_width, gap, gap + half_width), 1.1, 100, None)
        for name, gap in gaps.items()
    )  # fmt: skip
    judged = [axis for axis in axes if not math.isnan(axis.gap.value)]
    worst = max(judged, key=lambda axis: axis.gap.value) if judged else None
    gap = worst.gap if worst else UNKNOWN
    outcome = axis_status(gap, 15.0) if worst else "INCONCLUSIVE"
    fields: dict[str, Any] = {
        "id": number, "name": "lab", "night": FIRST + datetime.timedelta(days=number - 1),
        "key": f"{number:064d}", "evidence": f"{number:064d}", "measured": number,
        "dataset": "tiny", "dataset_hash": "0" * 64, "run": "vanilla", "run_key": "key0",
        "model": "vanilla", "expression": "all", "outcome": outcome,
        "exit_code": EXIT_CODES[outcome], "headline": outcome,
        "gap": gap, "worst": worst.axis if worst else None, "threshold": 15.0,
        "reason": "because", "change": None, "change_reason": None,
        "golden": None, "golden_change": UNKNOWN, "golden_margin": math.nan,
        "evidence_since": FIRST, "evidence_age": 0, "stale_after": 2.0,
        "written_at": "2026-11-16T03:00:00Z", "axes": axes,
    }  # fmt: skip
    return Night(**(fields | changes))


def week(**changes: Any) -> tuple[Night, ...]:
    """Seven nights; from night 5 on the task gap exceeds the threshold."""
    return tuple(
        night(number, {"visual": 4.0, "task": 7.0 if number < 5 else 27.0, "dynamics": 14.0},
              **changes)
        for number in range(1, 8)
    )  # fmt: skip


def history(*nights: Night) -> History:
    return History(nights)
