"""Every axis that the evidence allows, measured; and why the others are not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from s2rstore.errors import InconclusiveError
from s2rtools.gap.axis_result import Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.gate.reference import Frozen, freeze


@dataclass(frozen=True, slots=True)
class Measurement:
    """`absent` tells per axis what evidence lacks, `inconclusive` why there is too little of it."""

    measured: Mapping[str, AxisResult]
    absent: Mapping[str, str]
    inconclusive: Mapping[str, str]


def measure(evidence: Evidence, settings: GapSettings, axes: Mapping[str, Axis]) -> Measurement:
    """Measure each axis; raises RequestError for evidence that is wrong."""
    measured: dict[str, AxisResult] = {}
    absent: dict[str, str] = {}
    inconclusive: dict[str, str] = {}
    for name, axis in axes.items():
        lacking = axis.missing(evidence)
        if lacking is not None:
            absent[name] = lacking
            continue
        try:
            measured[name] = axis.measure(evidence, settings)
        except InconclusiveError as error:
            inconclusive[name] = str(error)
    return Measurement(measured, absent, inconclusive)


def frozen(
    found: Measurement, evidence: Evidence, settings: GapSettings, axes: Mapping[str, Axis]
) -> dict[str, Frozen]:
    """The scale of every measured axis; raises RequestError where one has no usable anchor."""
    return {
        name: freeze(measured, axes[name].anchor(evidence, settings), axes[name].unit, settings)
        for name, measured in found.measured.items()
    }
