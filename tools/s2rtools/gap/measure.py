"""Measure every axis that the evidence allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from s2rstore.errors import InconclusiveError
from s2rtools.gap.axis_result import Axis, AxisResult, Evidence, GapSettings


@dataclass(frozen=True, slots=True)
class Measurement:
    """Results by axis; `absent` and `inconclusive` hold the reasons for axes without a result."""

    measured: Mapping[str, AxisResult]
    absent: Mapping[str, str]
    inconclusive: Mapping[str, str]


def measure(evidence: Evidence, settings: GapSettings, axes: Mapping[str, Axis]) -> Measurement:
    """Measure each axis. Raises RequestError for invalid evidence."""
    measured: dict[str, AxisResult] = {}
    absent: dict[str, str] = {}
    inconclusive: dict[str, str] = {}
    for name, axis in axes.items():
        reason = axis.missing(evidence)
        if reason is not None:
            absent[name] = reason
            continue
        try:
            measured[name] = axis.measure(evidence, settings)
        except InconclusiveError as error:
            inconclusive[name] = str(error)
    return Measurement(measured, absent, inconclusive)
