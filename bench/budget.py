"""One measured value with its budget, and a timer."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any, Literal


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """One row of the bench; `budget` None marks a reference row without a limit.

    `sense` is the side of the budget on which a value passes; `details` are further figures.
    """

    name: str
    value: float
    unit: str
    budget: float | None = None
    sense: Literal["at most", "at least"] = "at most"
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        if self.budget is None:
            return True
        return self.value <= self.budget if self.sense == "at most" else self.value >= self.budget

    def as_json(self) -> dict[str, Any]:
        values = asdict(self)
        values.pop("sense")
        details = values.pop("details")
        return {**values, **details, "value": float(f"{self.value:.4g}"), "ok": self.ok}


def seconds(work: Callable[[], Any], times: int = 5) -> float:
    """Median wall time after one warm-up."""
    work()
    taken = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return median(taken)
