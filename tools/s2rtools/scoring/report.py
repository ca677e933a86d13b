"""Score report of a store: heatmaps, factors and changed objects against the ground truth.

The report is plain data rounded to six decimals, so that equal seeds give equal text. It is
stored in the provenance.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import check_writable, edit
from s2rstore.intervals import Interval
from s2rstore.intervals.interval import finite
from s2rstore.reader import Store
from s2rtools.common.command_line.progress import Reporter
from s2rtools.scoring import harm_report, heatmap_metrics
from s2rtools.scoring.counterfactual_errors import EvaluatedRuns, open_runs
from s2rtools.scoring.factor_effects import Counterfactuals
from s2rtools.scoring.factor_shares import measure_shares
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.object_gains import INSTANCES, measure_object_gains
from s2rtools.scoring.repair_curves import VIEWS, measure_repairs

ScoreReport = dict[str, Any]


@dataclass(frozen=True, slots=True)
class ScoreSettings:
    """Number of `instances` for counterfactual errors, and the random `seed` for ties.

    With `harm` also what harms the pose, from `views` real views per run, `repair_views` of which
    are rendered with several objects restored.
    """

    runs: tuple[str, ...] = ()
    trust: bool = False
    instances: int = 120
    seed: int = 1
    harm: bool = False
    views: int = INSTANCES
    repair_views: int = VIEWS

    def __post_init__(self) -> None:
        for option, count in (("--instances", self.instances), ("--views", self.views)):
            if not 2 <= count <= 100_000:
                raise RequestError(f"{option}: 2 .. 100000")
        if not 0 <= self.seed < 2**31:
            raise RequestError("--seed: 0 .. 2147483647")


def score(root: Path, settings: ScoreSettings, reporter: Reporter) -> ScoreReport:
    """Score the computed runs of a synthetic world's store.

    Raises RequestError if the ground truth is unknown or no run is computed.
    """
    with s2rstore.open(root) as store:
        truth = GroundTruth(store)
        runs = computed_runs(store, settings.runs)
        reporter.begin("score", 6 if settings.harm else 3)
        maps = heatmap_metrics.score_heatmaps(truth, runs, settings.seed)
        reporter.advance(1)
        evaluated = open_runs(store, runs, settings.trust)
        table = Counterfactuals(truth, evaluated, settings.instances)
        factors = table.factor_scores()
        reporter.advance(1)
        objects = table.object_scores()
        reporter.advance(1)
        report = {
            "seed": settings.seed,
            "instances": len(table.iids),
            "recipe": store.provenance_object("world", "recipe"),
            "runs": {name: store.run(name).key for name in runs},
            "heatmaps": [json_row(row) for row in maps],
            "factors": [json_row(row) for row in factors],
            "objects": [json_row(row) for row in objects],
        }
        if settings.harm:
            report["harm"] = _harm(truth, evaluated, settings, reporter)
        return report


def _harm(
    truth: GroundTruth, evaluated: EvaluatedRuns, settings: ScoreSettings,
    reporter: Reporter,
) -> ScoreReport:  # fmt: skip
    """What harms the pose: kinds against true gains, repair curves, and shares of the gap."""
    gains = measure_object_gains(truth, evaluated, settings.views)
    reporter.advance(1)
    repairs = measure_repairs(truth, evaluated, gains, settings.repair_views)
    reporter.advance(1)
    kinds, curves = [], []
    for estimates in harm_report.kind_estimates(truth.store, gains, settings.seed):
        kinds += harm_report.kind_scores(gains, estimates)
        if estimates.side == "real":
            curves += harm_report.kind_repairs(repairs, estimates)
    true = measure_shares(truth, evaluated, settings.instances)
    shares, largest = harm_report.share_scores(truth.store, true)
    reporter.advance(1)
    sections: dict[str, Sequence[object]] = {
        "kinds": kinds,
        "repairs": curves,
        "shares": shares,
        "largest_share": largest,
    }
    return {
        "views": {run: int(new.sum()) for run, new in gains.is_new.items()},
        "left_out": {run: int(truth.store.trained_instances(run).sum()) for run in gains.runs},
        **{name: [json_row(row) for row in rows] for name, rows in sections.items()},
    }


def save_report(root: Path, report: ScoreReport) -> bool:
    """Publish the report in the store's provenance; False if it is unchanged.

    What harms the pose is saved apart, as `harm` with its `runs`, so that a later score without it
    does not remove it.
    """
    check_writable(root)
    plain = {name: part for name, part in report.items() if name != "harm"}
    texts = {"report": json.dumps(plain, sort_keys=True)}
    if "harm" in report:
        harm = {**report["harm"], "runs": report["runs"], "recipe": report["recipe"]}
        texts["harm"] = json.dumps(harm, sort_keys=True)
    with s2rstore.open(root) as store:
        if texts.items() <= store.provenance("score").items():
            return False
    with edit(root) as draft:
        draft.set_provenance("score", texts)
    return True


def computed_runs(store: Store, requested: Sequence[str]) -> list[str]:
    store.require_poses("scoring")
    runs = [store.run(name) for name in dict.fromkeys(requested)] or [
        run for run in store.runs.values() if not run.is_imported
    ]
    missing = [run.run for run in runs if not run.key]
    if len(missing) == len(runs) or (requested and missing):
        names = ", ".join(missing) or "runs"
        raise RequestError(f"{store.path}: {names} not computed; run `s2r precompute` first")
    return [run.run for run in runs if run.key]


def json_row(row: Any) -> dict[str, Any]:
    """A record as JSON: intervals as columns, NaN as null, nested records flattened."""
    values: dict[str, Any] = {}
    for field in fields(row):
        value = getattr(row, field.name)
        if isinstance(value, Interval):
            values |= value.as_columns(field.name)
        elif is_dataclass(value):
            values |= json_row(value)
        else:
            values[field.name] = value
    for name, value in values.items():
        if isinstance(value, float):
            values[name] = finite(value)
    return values
