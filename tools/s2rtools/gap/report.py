"""Report of the gap of one run as JSON data; deterministic for the same evidence and seed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.metrics.bootstrap import Interval, percentile_interval
from s2rtools.gap.axis_result import Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.gate.golden_run import GoldenComparison
from s2rtools.gap.gate.reference import AxisScale, Reference
from s2rtools.gap.gate.verdict import NOTHING, AxisGap, Verdict
from s2rtools.gap.measure import Measurement
from s2rtools.gap.task.rank_consistency import RankConsistency

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class GapResult:
    """Measurement and verdict of the requested `axes`.

    `scales` are those of the reference, or those being frozen, which judge nothing yet.
    """

    measurement: Measurement
    verdict: Verdict
    axes: Mapping[str, Axis]
    scales: Mapping[str, AxisScale]
    reference: Reference | None = None
    golden: GoldenComparison | None = None
    across: Mapping[str, Any] | None = None


def report(evidence: Evidence, settings: GapSettings, result: GapResult) -> Report:
    """The complete report, rounded to nine digits; values that are not finite are null."""
    store = evidence.store
    run = store.run(evidence.run)
    verdict = result.verdict
    made = {
        "dataset": {"name": store.dataset.name, "hash": store.dataset.hash},
        "run": run.run,
        "run_key": run.key,
        "model": run.model,
        "model_sha256": store.models[run.model].sha256,
        "expression": evidence.expression,
        "selected": int(evidence.iids.size),
        "drives": [drive.name for drive in evidence.drives],
        "settings": {
            "replicates": settings.replicates,
            "seed": settings.seed,
            "level": settings.level,
            "pca": settings.pca,
        },
        "axes": [_axis(each, settings, result) for each in result.measurement.measured.values()],
        "absent": dict(result.measurement.absent),
        "inconclusive": dict(result.measurement.inconclusive),
        "across": result.across,
        "golden": None if result.golden is None else _golden(result.golden),
        "reference": _reference(result.reference),
        "verdict": {
            "outcome": verdict.outcome,
            "threshold": verdict.threshold,
            "worst": verdict.worst,
            **_bounds("gap", verdict.gap),
            "reason": verdict.reason,
        },
    }
    return plain(made)


def _axis(found: AxisResult, settings: GapSettings, result: GapResult) -> dict[str, Any]:
    axis = result.axes[found.axis]
    gaps = {each.axis: each for each in result.verdict.axes}
    return {
        "axis": found.axis,
        "measure": axis.measure_is,
        "unit": axis.unit,
        **_bounds("value", percentile_interval(found.value, found.replicates, settings.level)),
        **_bounds(
            "floor", percentile_interval(found.floor, found.floor_replicates, settings.level)
        ),
        "floor_is": axis.floor_is,
        "n": found.n,
        **_scaled(gaps.get(found.axis), result.scales.get(found.axis)),
        "fingerprint": dict(found.fingerprint),
        "details": dict(found.details),
        "notes": list(found.notes),
    }


def _scaled(gap: AxisGap | None, scale: AxisScale | None) -> dict[str, Any]:
    bounds = _bounds("gap", gap.gap if gap else NOTHING)
    if scale is None:
        return bounds
    anchor = Interval(scale.anchor_low, scale.anchor, scale.anchor_high)
    return {**bounds, **_bounds("anchor", anchor), "anchor_state": scale.state}


def _reference(found: Reference | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {"sha256": found.sha256, "made_from": dict(found.made_from)}


def _golden(found: GoldenComparison) -> dict[str, Any]:
    return {
        "outcome": found.outcome,
        **_bounds("change", found.change),
        "margin": found.margin,
        "n": found.n,
        "missing": found.missing,
        "reason": found.reason,
    }


def across_report(found: RankConsistency) -> Report:
    """Rank consistency as JSON data."""
    runs = zip(found.runs, found.sim, found.real, strict=True)
    return {
        "runs": [{"run": run, "sim": sim, "real": real} for run, sim, real in runs],
        "n": found.n,
        **_bounds("srcc", found.correlation),
        **_bounds("mmrv", found.rank_violation),
    }


def _bounds(name: str, found: Interval) -> dict[str, float]:
    return {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}


def plain(value: Any) -> Any:
    """JSON data: numbers rounded to nine digits, not finite ones as null, tuples as lists."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    return value
