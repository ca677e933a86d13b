"""From measured axes to one number and one word.

G = 100 (m - floor) / (anchor - floor) puts every axis on one scale: 0 is no gap, 100 the declared
bad state. The numerator is measured, with m and floor from the same resamples; the denominator is
the reference's, frozen, so that G moves only where the gap does. The headline is the worst axis,
and its interval takes the maximum inside each replicate, because the worst of several noisy figures
is larger than any one of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.gap_history.gate_status import Outcome, outcome_of
from s2rstore.metrics.bootstrap import Interval, percentile_interval
from s2rtools.gap import defaults
from s2rtools.gap.axis_result import AxisResult, Floats, GapSettings
from s2rtools.gap.gate.reference import Frozen, Reference
from s2rtools.gap.measure import Measurement

_HASH = re.compile("[0-9a-f]{64}")
NOTHING = Interval.unknown()
_REASONS: dict[Outcome, str] = {
    "PASS": "the whole interval is under the threshold of {:g}",
    "FAIL": "the whole interval is over the threshold of {:g}",
    "INCONCLUSIVE": "the interval reaches across the threshold of {:g}",
}


@dataclass(frozen=True, slots=True)
class AxisGap:
    """G of one axis with its interval, unclipped; `replicates` (R,)."""

    axis: str
    gap: Interval
    replicates: Floats


@dataclass(frozen=True, slots=True)
class Verdict:
    """The worst axis' G against the threshold; without axes to judge, INCONCLUSIVE."""

    outcome: Outcome
    threshold: float
    worst: str | None
    gap: Interval
    axes: tuple[AxisGap, ...]
    reason: str


def judge(
    found: Measurement,
    reference: Reference,
    settings: GapSettings,
    threshold: float = defaults.THRESHOLD,
) -> Verdict:
    """PASS where the interval is under the threshold, FAIL where it is over it.

    An axis with too little evidence leaves the verdict INCONCLUSIVE, unless another fails. Raises
    RequestError where the reference does not fit what was measured.
    """
    gaps, unsure = _gaps(found, reference, settings.level)
    if not gaps:
        return Verdict("INCONCLUSIVE", threshold, None, NOTHING, (), "; ".join(unsure))
    worst = max(gaps, key=lambda each: each.gap.value)
    together = np.max([each.replicates for each in gaps], axis=0)
    gap = percentile_interval(worst.gap.value, together, settings.level)
    outcome = outcome_of(gap, threshold)
    reason = _REASONS[outcome].format(threshold)
    beside = [axis for axis in found.measured if axis not in reference.axes]
    if beside:
        reason += f"; measured but not judged by this reference: {', '.join(beside)}"
    if unsure and outcome == "PASS":
        outcome, reason = "INCONCLUSIVE", "; ".join(unsure)
    return Verdict(outcome, threshold, worst.axis, gap, tuple(gaps), reason)


def _gaps(
    found: Measurement, reference: Reference, level: float
) -> tuple[list[AxisGap], list[str]]:
    """G of all that the reference judges, and what there is too little evidence for."""
    gaps: list[AxisGap] = []
    unsure: list[str] = []
    for axis, frozen in reference.axes.items():
        if axis in found.inconclusive:
            unsure.append(f"{axis}: {found.inconclusive[axis]}")
            continue
        if axis not in found.measured:
            lacking = found.absent.get(axis, "it was not asked for")
            raise RequestError(
                f"{reference.source}: judges {axis}, which cannot be measured here ({lacking}); "
                "give it, or freeze a reference without it"
            )
        _check_fits(found.measured[axis], frozen, reference.source)
        gaps.append(axis_gap(found.measured[axis], frozen, level))
    return gaps, unsure


def unjudged(threshold: float) -> Verdict:
    """What can be said without a reference."""
    reason = "no reference to judge by: `--freeze REF.json` writes one, `--reference` uses it"
    return Verdict("INCONCLUSIVE", threshold, None, NOTHING, (), reason)


def axis_gap(measured: AxisResult, frozen: Frozen, level: float) -> AxisGap:
    """G of a measured axis on the scale of a frozen one."""
    span = frozen.anchor - frozen.floor
    value = 100 * (measured.value - measured.floor) / span
    replicates = 100 * (measured.replicates - measured.floor_replicates) / span
    return AxisGap(measured.axis, percentile_interval(value, replicates, level), replicates)


def _check_fits(measured: AxisResult, frozen: Frozen, source: str) -> None:
    for key in sorted({*measured.fingerprint, *frozen.fingerprint}):
        here, there = measured.fingerprint.get(key), frozen.fingerprint.get(key)
        if here != there:
            raise RequestError(
                f"{source}: does not fit: {measured.axis}'s {key} is {_short(here)} here and "
                f"{_short(there)} in the reference; freeze one for what is measured here"
            )


def _short(value: object) -> str:
    """As much of a hash as people compare."""
    text = str(value)
    return text[:12] if _HASH.fullmatch(text) else text
