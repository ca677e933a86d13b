"""Report of the gap of one run as JSON data; deterministic for the same evidence and seed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.intervals import Interval
from s2rtools.gap.axis_result import Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.gate.golden_run import GoldenComparison
from s2rtools.gap.gate.reference import AxisScale, Reference
from s2rtools.gap.gate.verdict import NOTHING, Verdict
from s2rtools.gap.measure import Measurement
from s2rtools.gap.task.rank_consistency import RankConsistency

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class GapResult:
    """Measurement and verdict of the requested `axes`.

    `scales` are those of the reference, or new ones to be frozen, which do not judge this result.
    """

    measurement: Measurement
    verdict: Verdict
    axes: Mapping[str, Axis]
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
            "pca": settings.pca,
        },
        "axes": [_axis(each, settings, result) for each in result.measurement.measured.values()],
        "absent": dict(result.measurement.absent),
        "inconclusive": dict(result.measurement.inconclusive),
        "across": result.across,
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


def _axis(measured: AxisResult, settings: GapSettings, result: GapResult) -> dict[str, Any]:
    axis, scale = result.axes[measured.axis], result.scales.get(measured.axis)
    gaps = {each.axis: each.gap for each in result.verdict.axes}
    value = measured.bounds(settings.level)
    floor = Interval(measured.floor, measured.floor, measured.floor)
    anchor: dict[str, Any] = {}
    if scale is not None:
        interval = Interval(scale.anchor_low, scale.anchor, scale.anchor_high)
        anchor = {**interval.as_columns("anchor"), "anchor_state": scale.state}
    return {
        "axis": measured.axis,
        "measure": axis.measure_is,
        "unit": axis.unit,
        **value.as_columns("value"),
        "sample": value.text or None,
        **floor.as_columns("floor"),
        "floor_is": axis.floor_is,
        "n": measured.n,
        **gaps.get(measured.axis, NOTHING).as_columns("gap"),
        **anchor,
        "fingerprint": dict(measured.fingerprint),
        "details": dict(measured.details),
        "notes": list(measured.notes),
    }


def across_report(ranks: RankConsistency) -> Report:
    """Rank consistency as JSON data."""
    runs = zip(ranks.runs, ranks.sim, ranks.real, strict=True)
    return {
        "runs": [{"run": run, "sim": sim, "real": real} for run, sim, real in runs],
        "n": ranks.n,
        "scope": ranks.scope,
        "pearson": ranks.pearson,
        "kendall": ranks.kendall,
        **ranks.spearman.as_columns("spearman"),
        "chosen_run": ranks.chosen,
        "best_run": ranks.best,
        **ranks.regret.as_columns("regret"),
        "mmrv": ranks.rank_violation,
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
