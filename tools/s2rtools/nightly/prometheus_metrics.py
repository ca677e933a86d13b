"""Metrics of a night in the OpenMetrics text format.

All metrics are gauges, with one gauge per outcome, so that Prometheus' textfile collector can read
them; it does not support state sets. Unknown values have no line.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping
from typing import Any

from prometheus_client import CollectorRegistry
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.openmetrics.exposition import generate_latest
from prometheus_client.registry import Collector

from s2rstore.gap_history.gate_status import EXIT_CODES, EXIT_CODES_TEXT
from s2rstore.gap_history.reader import BOUNDS, Night
from s2rstore.intervals import Interval
from s2rtools.nightly.report_model import axis_check

HEADLINE = "headline"
Labels = tuple[str, ...]
_LABELS = ("nightly", "dataset", "run")
_ENDS = {"": "value", "_low": "low", "_high": "high"}


def metrics(night: Night) -> bytes:
    """The whole file, ending in `# EOF`."""
    registry = CollectorRegistry()
    registry.register(_NightCollector(night))
    return generate_latest(registry)


class _NightCollector(Collector):
    """One night's gauges."""

    def __init__(self, night: Night) -> None:
        self._night = night

    def collect(self) -> Iterator[GaugeMetricFamily]:
        night = self._night
        gaps = {HEADLINE: night.gap} | {axis.axis: axis.gap for axis in night.axes}
        outcomes = {HEADLINE: night.headline, "all": night.outcome}
        outcomes |= {axis.axis: axis_check(axis, night.threshold).outcome for axis in night.axes}
        outcomes = {axis: outcome for axis, outcome in outcomes.items() if outcome in EXIT_CODES}
        yield from self._interval_gauges(
            "s2r_gap", "G; 0 is no gap, 100 the declared bad state",
            {(axis,): gap for axis, gap in gaps.items()}, ("axis",),
        )  # fmt: skip
        yield self._gauge("s2r_gap_threshold", "threshold of G", {(): night.threshold})
        yield self._gauge(
            "s2r_gap_outcome", "1 for the present outcome; axis `all` decides the exit code",
            {(axis, each): float(each == outcome)
             for axis, outcome in outcomes.items() for each in EXIT_CODES},
            ("axis", "outcome"),
        )  # fmt: skip
        yield self._gauge(
            "s2r_gap_exit_code", EXIT_CODES_TEXT,
            {(axis,): EXIT_CODES[outcome] for axis, outcome in outcomes.items()}, ("axis",),
        )  # fmt: skip
        yield from self._interval_gauges(
            "s2r_gap_measure", "the measure behind G, in its unit",
            {(a.axis, a.unit or ""): a.value for a in night.axes if a.state == "measured"},
            ("axis", "unit"),
        )  # fmt: skip
        yield from self._interval_gauges(
            "s2r_gap_golden_change_metres", "mean real error against the golden run",
            {(): night.golden_change},
        )  # fmt: skip
        yield from self._interval_gauges(
            "s2r_gap_estimate", "identified simulator parameter, or exchange rate",
            {(each.parameter, each.unit): each.value for each in night.estimates},
            ("parameter", "unit"),
        )  # fmt: skip
        since = datetime.datetime.combine(night.evidence_since, datetime.time(), datetime.UTC)
        written = datetime.datetime.fromisoformat(night.written_at)
        for name, text, value in (
            ("evidence_age_days", "age of the newest recordings in this night", night.evidence_age),
            ("evidence_since_timestamp_seconds", "first night with the newest recordings",
             since.timestamp()),
            ("evidence_limit_days", "age from which the evidence is stale", night.stale_after),
            ("stale", "1 where the evidence is too old", night.stale),
            ("computed_timestamp_seconds", "when this night was written", written.timestamp()),
        ):  # fmt: skip
            yield self._gauge(f"s2r_gap_{name}", text, {(): float(value)})

    def _gauge(
        self, name: str, text: str, samples: Mapping[Any, float], labels: Labels = ()
    ) -> GaugeMetricFamily:
        """A gauge with `samples` by the values of `labels`."""
        night = self._night
        family = GaugeMetricFamily(name, text, labels=(*_LABELS, *labels))
        for label, value in samples.items():
            if math.isfinite(value):
                family.add_metric((night.name, night.dataset, night.run, *label), float(value))
        return family

    def _interval_gauges(
        self, name: str, text: str, intervals: Mapping[Any, Interval], labels: Labels = ()
    ) -> Iterator[GaugeMetricFamily]:
        """Three gauges: an estimate and its bounds."""
        for end, part in _ENDS.items():
            samples = {label: getattr(interval, part) for label, interval in intervals.items()}
            yield self._gauge(f"{name}{end}", f"{text}{BOUNDS[end]}", samples, labels)
