"""The whole gap of one run as plain data: the same seed and evidence give the same text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.metrics.bootstrap import Interval, percentile_interval
from s2rtools.gap.axis_result import Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.gate.golden_run import Compared
from s2rtools.gap.gate.reference import Frozen, Reference
from s2rtools.gap.gate.verdict import NOTHING, AxisGap, Verdict
from s2rtools.gap.measure import Measurement
from s2rtools.gap.task.rank_consistency import RankConsistency

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Judged:
    """All that was found; `axes` are those that were asked for.

    `scale` is that of the reference, or the one that is frozen now, which judges nothing yet.
    """

    found: Measurement
    verdict: Verdict
    axes: Mapping[str, Axis]
    scale: Mapping[str, Frozen]
    reference: Reference | None = None
    golden: Compared | None = None
    across: Mapping[str, Any] | None = None


def report(evidence: Evidence, settings: GapSettings, judged: Judged) -> Report:
    """Everything that was found, rounded to nine digits; what is not finite is null."""
    store = evidence.store
    run = store.run(evidence.run)
    verdict = judged.verdict
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
        "axes": [_axis(each, settings, judged) for each in judged.found.measured.values()],
        "absent": dict(judged.found.absent),
        "inconclusive": dict(judged.found.inconclusive),
        "across": judged.across,
        "golden": None if judged.golden is None else _golden(judged.golden),
        "reference": _reference(judged.reference),
        "verdict": {
            "outcome": verdict.outcome,
            "threshold": verdict.threshold,
            "worst": verdict.worst,
            **_bounds("gap", verdict.gap),
            "reason": verdict.reason,
        },
    }
    return plain(made)


def _axis(found: AxisResult, settings: GapSettings, judged: Judged) -> dict[str, Any]:
    axis = judged.axes[found.axis]
    gaps = {each.axis: each for each in judged.verdict.axes}
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
        **_scaled(gaps.get(found.axis), judged.scale.get(found.axis)),
        "fingerprint": dict(found.fingerprint),
        "details": dict(found.details),
        "notes": list(found.notes),
    }


def _scaled(gap: AxisGap | None, frozen: Frozen | None) -> dict[str, Any]:
    bounds = _bounds("gap", gap.gap if gap else NOTHING)
    if frozen is None:
        return bounds
    anchor = Interval(frozen.anchor_low, frozen.anchor, frozen.anchor_high)
    return {**bounds, **_bounds("anchor", anchor), "anchor_state": frozen.state}


def _reference(found: Reference | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {"sha256": found.sha256, "made_from": dict(found.made_from)}


def _golden(found: Compared) -> dict[str, Any]:
    return {
        "outcome": found.outcome,
        **_bounds("change", found.change),
        "margin": found.margin,
        "n": found.n,
        "missing": found.missing,
        "reason": found.reason,
    }


def across_report(found: RankConsistency) -> Report:
    """How simulation and reality rank the runs."""
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
    """JSON data: numpy's numbers as Python's, rounded; not finite as null; tuples as lists."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    return value
