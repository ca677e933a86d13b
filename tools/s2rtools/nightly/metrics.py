"""A night as metrics: gauges in the OpenMetrics text format.

Gauges only, and the outcome as one gauge per word: so the file is read by Prometheus' own text
collectors, too, which know no state sets. What is unknown has no line.
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

from s2rstore.gap_history.gate_status import CODES_TOLD, EXIT_CODES
from s2rstore.gap_history.reader import Night
from s2rstore.gap_history.schema import BOUNDS
from s2rstore.metrics.bootstrap import Interval
from s2rtools.nightly.night_status import axis_check

HEADLINE = "headline"
Labels = tuple[str, ...]
Found = Mapping[Any, Interval]
"""By the values of labels."""
_OF = ("nightly", "dataset", "run")
_ENDS = {"": "value", "_low": "low", "_high": "high"}


def metrics(night: Night) -> bytes:
    """The whole file, ending in `# EOF`."""
    registry = CollectorRegistry()
    registry.register(_Families(night))
    return generate_latest(registry)


class _Families(Collector):
    """One night's gauges."""

    def __init__(self, night: Night) -> None:
        self._night = night
        self._of = (night.name, night.dataset, night.run)

    def collect(self) -> Iterator[GaugeMetricFamily]:
        night = self._night
        gaps = {HEADLINE: night.gap} | {axis.axis: axis.gap for axis in night.axes}
        yield from self._bounds("s2r_gap", "G; 0 is no gap, 100 the declared bad state", ("axis",),
                                {(axis,): gap for axis, gap in gaps.items()})  # fmt: skip
        yield self._one("s2r_gap_threshold", "of G", night.threshold)
        words = {HEADLINE: night.headline, "all": night.outcome}
        words |= {axis.axis: axis_check(axis, night.threshold).word for axis in night.axes}
        yield self._words(words)
        yield self._codes(words)
        measured = {(a.axis, a.unit or ""): a.value for a in night.axes if a.state == "measured"}
        yield from self._bounds("s2r_gap_measure", "the measure behind G, in its unit",
                                ("axis", "unit"), measured)  # fmt: skip
        yield from self._bounds("s2r_gap_golden_change_metres",
                                "mean real error against the golden run", (),
                                {(): night.golden_change})  # fmt: skip
        found = {(each.parameter, each.unit): each.value for each in night.estimates}
        yield from self._bounds("s2r_gap_estimate", "the simulator's parameter, identified",
                                ("parameter", "unit"), found)  # fmt: skip
        age, since = float(night.evidence_age), _midnight(night.evidence_since)
        yield self._one("s2r_gap_evidence_age_days", "of what was recorded, at this night", age)
        yield self._one("s2r_gap_evidence_since_timestamp_seconds", "its first night", since)
        yield self._one("s2r_gap_evidence_limit_days", "from which on it is stale",
                        night.stale_after)  # fmt: skip
        yield self._one("s2r_gap_stale", "1 where the evidence is too old", float(night.stale))
        written = datetime.datetime.fromisoformat(night.written_at).timestamp()
        yield self._one("s2r_gap_computed_timestamp_seconds", "when this night was written",
                        written)  # fmt: skip

    def _one(self, name: str, told: str, value: float) -> GaugeMetricFamily:
        family = GaugeMetricFamily(name, told, labels=_OF)
        family.add_metric(self._of, value)
        return family

    def _words(self, words: dict[str, str]) -> GaugeMetricFamily:
        family = GaugeMetricFamily(
            "s2r_gap_outcome", "1 for the word that holds; axis `all` is what the gate obeys",
            labels=(*_OF, "axis", "outcome"),
        )  # fmt: skip
        for axis, word in words.items():
            for each in EXIT_CODES if word in EXIT_CODES else ():
                family.add_metric((*self._of, axis, each), float(each == word))
        return family

    def _codes(self, words: dict[str, str]) -> GaugeMetricFamily:
        family = GaugeMetricFamily("s2r_gap_exit_code", CODES_TOLD,
                                   labels=(*_OF, "axis"))  # fmt: skip
        for axis, word in words.items():
            if word in EXIT_CODES:
                family.add_metric((*self._of, axis), float(EXIT_CODES[word]))
        return family

    def _bounds(
        self, name: str, told: str, labels: Labels, found: Found
    ) -> Iterator[GaugeMetricFamily]:
        """Three gauges: the estimate and its bounds."""
        for end, part in _ENDS.items():
            family = GaugeMetricFamily(f"{name}{end}", f"{told}{BOUNDS[end]}",
                                       labels=(*_OF, *labels))  # fmt: skip
            for label, interval in found.items():
                value = getattr(interval, part)
                if math.isfinite(value):
                    family.add_metric((*self._of, *label), value)
            yield family


def _midnight(day: datetime.date) -> float:
    return datetime.datetime(day.year, day.month, day.day, tzinfo=datetime.UTC).timestamp()
