"""Report of the gap of one run as JSON data; deterministic for the same evidence and seed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.intervals import Interval
from s2rstore.metrics.exchange import exchange_change
from s2rtools.gap.axes import AXES, configured
from s2rtools.gap.axis import Evidence, GapSettings, Measurement
from s2rtools.gap.gate.golden_run import GoldenComparison
from s2rtools.gap.gate.verdict import NOTHING, AxisScale, Reference, Verdict

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class GapResult:
    """Measurement and verdict of the requested axes with their `options`, texts by name.

    `scales` are those of the reference, or new ones to be frozen, which do not judge this result.
    """

    measurement: Measurement
    verdict: Verdict
    options: Mapping[str, str]
    scales: Mapping[str, AxisScale]
    reference: Reference | None = None
    golden: GoldenComparison | None = None
    across: Mapping[str, Any] | None = None


def report(evidence: Evidence, settings: GapSettings, result: GapResult) -> Report:
    """The complete report, rounded to nine digits; non-finite values are null."""
    store = evidence.store
    run = store.run(evidence.run)
    verdict, golden, reference = result.verdict, result.golden, result.reference
    content = {
        "dataset": {"name": store.dataset.name, "hash": store.dataset.hash},
        "run": run.run,
        "run_key": run.key,
        "model": run.model,
        "model_sha256": run.model and store.models[run.model].sha256,
        "expression": evidence.expression,
        "selected": int(evidence.iids.size),
        "note": store.coverage(run.run).note,
        "drives": [drive.name for drive in evidence.drives],
        "settings": {
            "seed": settings.seed,
            "level": settings.level,
            **_numbers(result.options),
        },
        "axes": [_axis(name, settings, result) for name in result.measurement.measured],
        "absent": dict(result.measurement.absent),
        "inconclusive": dict(result.measurement.inconclusive),
        "across": result.across,
        "exchange": _exchange(evidence),
        "golden": None if golden is None else {
            "outcome": golden.outcome,
            **golden.change.as_columns("change"),
            "margin": golden.margin,
            "n": golden.n,
            "missing": golden.missing,
            "reason": golden.reason,
        },
        "reference": None if reference is None else {
            "sha256": reference.sha256,
            "made_from": dict(reference.made_from),
        },
        "verdict": {
            "outcome": verdict.outcome,
            "threshold": verdict.threshold,
            "worst": verdict.worst,
            **verdict.gap.as_columns("gap"),
            "reason": verdict.reason,
        },
    }  # fmt: skip
    return plain(content)


def _exchange(evidence: Evidence) -> dict[str, Any] | None:
    """The exchange rate of the run before and after its images were changed.

    None where no selected pair is new to the run and to that of its model on unchanged images.
    """
    members = np.zeros(len(evidence.store.instances), dtype=np.bool_)
    members[evidence.iids] = True
    try:
        return exchange_change(evidence.store, evidence.run, members).as_json()
    except RequestError:
        return None


def _numbers(options: Mapping[str, str]) -> dict[str, Any]:
    """The values of all options that are written as --NAME VALUE."""
    axes = configured(options)
    names = [(axis, name) for axis, of in AXES.items() if of.flag is None for name in of.options]
    return {name: getattr(axes[axis], name) for axis, name in names}


def _axis(name: str, settings: GapSettings, result: GapResult) -> dict[str, Any]:
    record, scale = AXES[name], result.scales.get(name)
    measured = result.measurement.measured[name]
    value = measured.bounds(settings.level)
    floor = Interval(measured.floor, measured.floor, measured.floor)
    anchor: dict[str, Any] = {}
    if scale is not None:
        interval = Interval(scale.anchor_low, scale.anchor, scale.anchor_high)
        anchor = {**interval.as_columns("anchor"), "anchor_state": scale.state}
    return {
        "axis": name,
        "measure": record.measure,
        "unit": record.unit,
        **value.as_columns("value"),
        "sample": value.text or None,
        **floor.as_columns("floor"),
        "floor_is": record.floor,
        "n": measured.n,
        **result.verdict.gaps.get(name, NOTHING).as_columns("gap"),
        **anchor,
        "fingerprint": dict(measured.fingerprint),
        "details": dict(measured.details),
        "notes": list(measured.notes),
    }


def plain(value: Any) -> Any:
    """JSON data: numbers rounded to nine digits, non-finite ones as null, tuples as lists."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    return value
