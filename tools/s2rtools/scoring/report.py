"""A store's whole score: heatmaps against the labelled changes, factors and objects against error.

The report is plain data with six decimals, so that one seed gives one text; the store keeps it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import check_writable, edit
from s2rstore.metrics.bootstrap import Interval
from s2rstore.reader import Store
from s2rtools.inference import open_backend
from s2rtools.models.library import load_model
from s2rtools.precompute.pipeline import ProgressReporter
from s2rtools.scoring import heatmaps
from s2rtools.scoring.factor_effects import Counterfactuals
from s2rtools.scoring.ground_truth import Truth

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class ScoreSettings:
    """`instances` of the counterfactual table, spread over the data set; `seed` breaks ties."""

    runs: tuple[str, ...] = ()
    trust: bool = False
    instances: int = 120
    seed: int = 1

    def __post_init__(self) -> None:
        if not 2 <= self.instances <= 100_000:
            raise RequestError("--instances: 2 .. 100000")
        if not 0 <= self.seed < 2**31:
            raise RequestError("--seed: 0 .. 2147483647")


def score(root: Path, settings: ScoreSettings, reporter: ProgressReporter) -> Report:
    """Score the computed runs of a world's store.

    Raises RequestError where no truth is known or nothing is computed.
    """
    with s2rstore.open(root) as store:
        truth = Truth(store)
        runs = _computed(store, settings.runs)
        reporter.begin("score", 3)
        maps = heatmaps.scores(truth, runs, settings.seed)
        reporter.advance(1)
        judges = [
            (
                store.run(name),
                open_backend(load_model(store, store.run(name).model, settings.trust), "torch"),
            )
            for name in runs
        ]
        table = Counterfactuals(truth, judges, settings.instances)
        factors = table.factor_scores()
        reporter.advance(1)
        objects = table.object_scores()
        reporter.advance(1)
        return {
            "seed": settings.seed,
            "instances": len(table.iids),
            "recipe": store.provenance_object("world", "recipe"),
            "runs": {name: store.run(name).key for name in runs},
            "heatmaps": [_plain(row) for row in maps],
            "factors": [_plain(row) for row in factors],
            "objects": [_plain(row) for row in objects],
        }


def keep(root: Path, report: Report) -> bool:
    """Publish the report in the store's provenance; False where it holds the very same."""
    check_writable(root)
    text = json.dumps(report, sort_keys=True)
    with s2rstore.open(root) as store:
        if store.provenance("score").get("report") == text:
            return False
    with edit(root) as draft:
        draft.note("score", {"report": text})
    return True


def _computed(store: Store, wanted: Sequence[str]) -> list[str]:
    runs = [store.run(name) for name in dict.fromkeys(wanted)] or list(store.runs.values())
    missing = [run.run for run in runs if not run.key]
    if len(missing) == len(runs) or (wanted and missing):
        told = ", ".join(missing) or "no run"
        raise RequestError(f"{store.path}: {told} not computed; run `s2r precompute` first")
    return [run.run for run in runs if run.key]


def _plain(row: Any) -> dict[str, Any]:
    """A record as JSON can hold it: intervals as three figures, NaN as null."""
    made: dict[str, Any] = {}
    for field in fields(row):
        value = getattr(row, field.name)
        if isinstance(value, Interval):
            low_high = asdict(value)
            made[field.name] = _figure(low_high["value"])
            made[f"{field.name}_low"] = _figure(low_high["low"])
            made[f"{field.name}_high"] = _figure(low_high["high"])
        else:
            made[field.name] = _figure(value) if isinstance(value, float) else value
    return made


def _figure(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None
