"""Verdicts on several quantities at once, each with a threshold: intersection-union tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from s2rstore.intervals.interval import LEVEL, Interval, simultaneous_level

Outcome = Literal["PASS", "FAIL", "INCONCLUSIVE"]
Bounds = Callable[[float], Interval]
"""The interval of one quantity at a level."""


class HasBounds(Protocol):
    """Any interval; its bounds are NaN where it is not known."""

    @property
    def low(self) -> float: ...

    @property
    def high(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Judgement:
    """An outcome, and the quantities that decide it.

    Those of a FAIL are above their thresholds, those of an INCONCLUSIVE not known to be below.
    """

    outcome: Outcome
    deciding: tuple[str, ...]


def judge(
    quantities: Mapping[str, Callable[[float], HasBounds]],
    thresholds: Mapping[str, float],
    level: float = LEVEL,
    fail_level: float | None = None,
) -> Judgement:
    """Whether all quantities, given by their bounds at a level, lie below their thresholds.

    FAIL where the lower bound of any of k quantities lies above its threshold, by intervals at
    1 - (1 - level) / k, so that k quantities on their thresholds fail as rarely as one. PASS where
    every upper bound at `level` lies below its threshold, which needs no correction: one quantity
    above its threshold prevents it. `fail_level` replaces `level` for a FAIL. Source: Berger,
    "Multiparameter hypothesis testing and acceptance sampling", Technometrics 24, 1982.
    """
    corrected = simultaneous_level(len(quantities), fail_level or level)
    above = tuple(
        name for name, bounds in quantities.items() if bounds(corrected).low > thresholds[name]
    )
    if above:
        return Judgement("FAIL", above)
    unknown = tuple(
        name for name, bounds in quantities.items() if not bounds(level).high < thresholds[name]
    )
    return Judgement("INCONCLUSIVE" if unknown or not quantities else "PASS", unknown)


def largest(quantities: Iterable[Bounds], level: float = LEVEL) -> Interval:
    """The largest of several quantities, each with its bounds at any level.

    The lower bound is the largest one at 1 - (1 - level) / k, because the quantity whose estimate
    is largest is chosen by chance, too; the upper bound is the largest one at `level`.
    """
    bounds = list(quantities)
    if not bounds:
        return Interval.unknown(reason="there is no quantity")
    value = max(each(level).value for each in bounds)
    corrected = [each(simultaneous_level(len(bounds), level)) for each in bounds]
    reasons = [each.reason for each in corrected if not each.is_known]
    if reasons:
        return Interval.unknown(value, reasons[0])
    high = max(each(level).high for each in bounds)
    return Interval(max(each.low for each in corrected), value, high, level)
