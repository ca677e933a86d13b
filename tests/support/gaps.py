"""Nights of a history as they are read, made by code."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping
from typing import Any

from s2rstore.gap_history.gate_status import EXIT_CODES, word_of
from s2rstore.gap_history.reader import AxisFigures, History, Night
from s2rstore.metrics.bootstrap import Interval

FIRST = datetime.date(2026, 11, 16)
NOTHING = Interval.unknown()


def night(number: int, gaps: Mapping[str, float], half: float = 2.0, **changes: Any) -> Night:
    """Night `number` (1 is the first) whose axes have these G +- `half`; NaN is not judged."""
    axes = tuple(
        AxisFigures(name, "measured", name, "m", Interval(0.1, 0.2, 0.3), Interval(0.1, 0.1, 0.1),
                    Interval(gap - half, gap, gap + half), 1.1, 100, None)
        for name, gap in gaps.items()
    )  # fmt: skip
    judged = [axis for axis in axes if not math.isnan(axis.gap.value)]
    worst = max(judged, key=lambda axis: axis.gap.value) if judged else None
    gap = worst.gap if worst else NOTHING
    word = word_of(gap, 15.0) if worst else "INCONCLUSIVE"
    fields: dict[str, Any] = {
        "id": number, "name": "lab", "night": FIRST + datetime.timedelta(days=number - 1),
        "key": f"{number:064d}", "evidence": f"{number:064d}", "measured": number,
        "dataset": "tiny", "dataset_hash": "0" * 64, "run": "vanilla", "run_key": "key0",
        "model": "vanilla", "expression": "all", "outcome": word,
        "exit_code": EXIT_CODES[word], "headline": word,
        "gap": gap, "worst": worst.axis if worst else None, "threshold": 15.0,
        "reason": "because", "golden": None, "golden_change": NOTHING, "golden_margin": math.nan,
        "evidence_since": FIRST, "evidence_age": 0, "stale_after": 2.0,
        "written_at": "2026-11-16T03:00:00Z", "axes": axes,
    }  # fmt: skip
    return Night(**(fields | changes))


def week(**changes: Any) -> tuple[Night, ...]:
    """Seven nights; from day 5 on the task's gap is over the threshold."""
    return tuple(
        night(number, {"visual": 4.0, "task": 7.0 if number < 5 else 27.0, "dynamics": 14.0},
              **changes)
        for number in range(1, 8)
    )  # fmt: skip


def history(*found: Night) -> History:
    return History(found)
