"""A finding: one statement about a run, with its evidence and the instances that it concerns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from s2rstore.intervals import Interval
from s2rstore.intervals.interval import finite
from s2rstore.language import Node, to_text
from s2rstore.security.printable_text import printable

MIN_INSTANCES = 5
"""Fewest instances that a finding is based on."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One statement about a run.

    kind: what is stated, such as `worst room`. text: what is measured, in one line with n and the
    interval. evidence: why it is evident or not, in one line; may be empty. evident: whether the
    evidence suffices. values: figures by names that end in their units. interval: of the value
    `interval_of`, at a level of its own where `comparisons` > 1 were made. n: number of
    `n_of`; where `node` is not None, it selects these n instances of `run`. view: the view
    that shows it. other: the run that `run` is compared with. heat: (kind, mode) of a heatmap.
    grouping: how the rooms view groups errors for it, such as `heading`.
    """

    kind: str
    text: str
    run: str
    n: int
    evidence: str = ""
    evident: bool = True
    values: Mapping[str, float | str] = field(default_factory=dict)
    interval: Interval | None = None
    interval_of: str = ""
    comparisons: int = 1
    n_of: str = "instances"
    node: Node | None = None
    view: str = "map"
    other: str | None = None
    heat: tuple[str, str | None] | None = None
    grouping: str | None = None

    @property
    def expression(self) -> str | None:
        """The text of the expression that selects its instances; None where it concerns none."""
        return None if self.node is None else to_text(self.node)

    @property
    def statement(self) -> str:
        """The text, which says so where the finding is not evident."""
        return self.text if self.evident else f"{self.text}; not evident"

    @property
    def message(self) -> str:
        """Kind and text for a line that may be cut: what is not evident says so first."""
        return f"{self.kind}{'' if self.evident else ' (not evident)'}: {self.text}"

    @property
    def line(self) -> str:
        """The statement and its evidence in one line."""
        return "; ".join(part for part in (self.statement, self.evidence) if part)

    def as_json(self) -> dict[str, Any]:
        """The finding as JSON data; unknown numbers are null."""
        interval = None
        if self.interval is not None:
            interval = {
                "of": self.interval_of,
                **self.interval.as_json(),
                "comparisons": self.comparisons,
            }
        return {
            "kind": self.kind,
            "text": printable(self.statement),
            "evidence": printable(self.evidence),
            "evident": self.evident,
            "run": self.run,
            "other_run": self.other,
            "n": self.n,
            "n_of": self.n_of,
            "values": {name: _known(value) for name, value in self.values.items()},
            "interval": interval,
            "expression": self.expression,
        }


@dataclass(frozen=True, slots=True)
class FindingReport:
    """The findings about a run, and the lines that say which ones are missing and why."""

    run: str
    findings: tuple[Finding, ...]
    missing: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """How many findings are evident, in one line."""
        evident = sum(finding.evident for finding in self.findings)
        if not evident:
            return f"nothing is evident for {self.run}"
        return f"{evident} of {len(self.findings)} findings are evident for {self.run}"


def bounds_text(interval: Interval, unit: str = "", signed: bool = False) -> str:
    """`0.84 to 1.57 m`, or why there is no interval."""
    return interval.bounds_text(("{:+.2f}" if signed else "{:.2f}").format, unit)


def sample_text(interval: Interval, n: int) -> str:
    """`n 100, about 31 independent`; `n 7` where the interval is not known."""
    return interval.text or f"n {n}"


def evidence_text(interval: Interval, comparisons: int, of: str) -> str:
    """`1.20 to 2.10 m, corrected for 7 rooms`: the bounds of a difference in metres."""
    if not interval.is_known:
        return "not tested"
    bounds = bounds_text(interval, "m", signed=True)
    return f"{bounds}, corrected for {comparisons} {of}" if comparisons > 1 else bounds


def _known(value: float | str) -> float | str | None:
    if isinstance(value, str):
        return printable(value)
    return finite(value)
