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
from s2rstore.gap_history.reader import Night
from s2rstore.gap_history.schema import BOUNDS
from s2rstore.metrics.bootstrap import Interval
from s2rtools.nightly.report_model import axis_check

HEADLINE = "headline"
Labels = tuple[str, ...]
Intervals = Mapping[Any, Interval]
"""Intervals by the values of their labels."""
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
        self._values = (night.name, night.dataset, night.run)

    def collect(self) -> Iterator[GaugeMetricFamily]:
        night = self._night
        gaps = {HEADLINE: night.gap} | {axis.axis: axis.gap for axis in night.axes}
        yield from self._interval_gauges("s2r_gap",
                                "G; 0 is no gap, 100 the declared bad state", ("axis",),
                                {(axis,): gap for axis, gap in gaps.items()})  # fmt: skip
        yield self._gauge("s2r_gap_threshold", "threshold of G", night.threshold)
        words = {HEADLINE: night.headline, "all": night.outcome}
        words |= {axis.axis: axis_check(axis, night.threshold).outcome for axis in night.axes}
        yield self._outcome_gauge(words)
        yield self._exit_code_gauge(words)
        measured = {(a.axis, a.unit or ""): a.value for a in night.axes if a.state == "measured"}
        yield from self._interval_gauges("s2r_gap_measure", "the measure behind G, in its unit",
                                ("axis", "unit"), measured)  # fmt: skip
        yield from self._interval_gauges("s2r_gap_golden_change_metres",
                                "mean real error against the golden run", (),
                                {(): night.golden_change})  # fmt: skip
        estimates = {(each.parameter, each.unit): each.value for each in night.estimates}
        yield from self._interval_gauges("s2r_gap_estimate", "identified simulator parameter",
                                ("parameter", "unit"), estimates)  # fmt: skip
        age, since = float(night.evidence_age), _midnight(night.evidence_since)
        yield self._gauge(
            "s2r_gap_evidence_age_days", "age of the newest recordings in this night", age
        )
        yield self._gauge(
            "s2r_gap_evidence_since_timestamp_seconds",
            "first night with the newest recordings",
            since,
        )
        yield self._gauge("s2r_gap_evidence_limit_days", "age from which the evidence is stale",
                        night.stale_after)  # fmt: skip
        yield self._gauge("s2r_gap_stale", "1 where the evidence is too old", float(night.stale))
        written = datetime.datetime.fromisoformat(night.written_at).timestamp()
        yield self._gauge("s2r_gap_computed_timestamp_seconds", "when this night was written",
                        written)  # fmt: skip

    def _gauge(self, name: str, description: str, value: float) -> GaugeMetricFamily:
        family = GaugeMetricFamily(name, description, labels=_LABELS)
        family.add_metric(self._values, value)
        return family

    def _outcome_gauge(self, words: dict[str, str]) -> GaugeMetricFamily:
        family = GaugeMetricFamily(
            "s2r_gap_outcome", "1 for the present outcome; axis `all` decides the exit code",
            labels=(*_LABELS, "axis", "outcome"),
        )  # fmt: skip
        for axis, word in words.items():
            for each in EXIT_CODES if word in EXIT_CODES else ():
                family.add_metric((*self._values, axis, each), float(each == word))
        return family

    def _exit_code_gauge(self, words: dict[str, str]) -> GaugeMetricFamily:
        family = GaugeMetricFamily("s2r_gap_exit_code", EXIT_CODES_TEXT,
                                   labels=(*_LABELS, "axis"))  # fmt: skip
        for axis, word in words.items():
            if word in EXIT_CODES:
                family.add_metric((*self._values, axis), float(EXIT_CODES[word]))
        return family

    def _interval_gauges(
        self, name: str, description: str, labels: Labels, intervals: Intervals
    ) -> Iterator[GaugeMetricFamily]:
        """Three gauges: an estimate and its bounds."""
        for end, part in _ENDS.items():
            family = GaugeMetricFamily(f"{name}{end}", f"{description}{BOUNDS[end]}",
                                       labels=(*_LABELS, *labels))  # fmt: skip
            for label, interval in intervals.items():
                value = getattr(interval, part)
                if math.isfinite(value):
                    family.add_metric((*self._values, *label), value)
            yield family


def _midnight(day: datetime.date) -> float:
    return datetime.datetime(day.year, day.month, day.day, tzinfo=datetime.UTC).timestamp()
