"""How well heatmaps and shares tell what harms a pose, in buildings that no model knew.

Each building is ingested, its runs (the pretrained models, and a network that was never trained)
are computed, and `s2r score --harm`'s truth is measured for the pretrained ones. Stores that exist
in the folder are used again.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.torch import save_file

import s2rstore
from bench.budget import BudgetRow
from bench.measured_stores import QUIET, lively
from s2rstore.reader import Store
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.heatmaps.harm import Harm
from s2rtools.precompute.label_gains import image_gains
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.scoring import harm_report
from s2rtools.scoring.counterfactual_errors import open_runs
from s2rtools.scoring.factor_shares import measure_shares
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.harm_metrics import HarmScore, ScoredPairs, harm_score, pool_runs, pool_stores
from s2rtools.scoring.object_gains import ObjectGains, measure_object_gains
from s2rtools.scoring.statistics import weighted_pearson
from s2rtools.synthetic_world.factors import FACTOR_GROUPS
from s2rtools.training import pretrained

SEEDS = (21, 22, 23)
"""Buildings on which nothing was tuned; `--seeds` names others."""
VIEWS = 200
SHARE_VIEWS = 60
_UNTRAINED = "untrained"
_STORED = "stored gains of labels"
"""Stands for table `label_gain`, made of harm and stored label images, in place of a kind."""
_REAL_LABELS = "gains of real labels alone"
"""The same without the label images of the sim side."""
_BUDGETS = {
    "harm": (0.90, 0.78, 0.85, 0.60, 0.65),
    _STORED: (0.90, 0.80, None, None, None),
}
"""Least AUROC and rank correlation, pooled and of each run and building; share of right claims."""

_SHARE_BUDGETS = {"lighting": 0.90, "depth": 0.80, "objects": 0.60}
"""Least correlation of the shares of `gap_shares` with the true ones."""

Mode = tuple[str, str | None]
SharePair = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """Pairs of one building by kind and mode, and by run.

    `own` have the run's own map, `foreign` another run's, `untrained` that of random weights.
    `shares` are true and estimated shares of the gap of each run, by estimator.
    """

    seed: int
    own: dict[Mode, dict[str, ScoredPairs]]
    foreign: dict[Mode, dict[str, ScoredPairs]]
    untrained: dict[Mode, dict[str, ScoredPairs]]
    shares: dict[str, list[SharePair]]


def figures(
    folder: Path,
    seeds: Sequence[int] = SEEDS,
    views: int = VIEWS,
    kinds: Sequence[str] = tuple(HEATMAP_KINDS),
) -> Iterator[BudgetRow]:
    """Rows of each kind and mode: pooled, of each building, and the weakest run of any building."""
    buildings = [_measure(folder / f"building-{seed}.s2r", seed, views, kinds) for seed in seeds]
    for mode in buildings[0].own:
        parts = {b.seed: pool_runs([*b.own[mode].values()]) for b in buildings}
        pooled = harm_score(pool_stores([*parts.values()]))
        name, budgets = _name(mode), _BUDGETS.get(mode[0], (None,) * 5)
        yield from _ranking(f"{name}, pooled, {_counts(pooled)}", pooled, *budgets[:2])
        if pooled.claims:
            claims = f"{name}, claims that are right, {pooled.claims}"
            yield BudgetRow(claims, pooled.precision.value, "share", budgets[4], "at least")
            yield BudgetRow("... right at random", pooled.base_rate, "share")
            yield BudgetRow("... metres delivered by a claim", pooled.delivered.value, "m")
            yield BudgetRow("... metres at random", pooled.mean_gain, "m")
        for seed, part in parts.items():
            yield from _ranking(f"{name}, building {seed}", harm_score(part))
        each = [harm_score(pairs) for b in buildings for pairs in b.own[mode].values()]
        yield from _weakest(f"{name}, weakest run of a building", each, *budgets[2:4])
        references = {
            "another run's map": [b.foreign[mode] for b in buildings],
            "map of random weights": [b.untrained[mode] for b in buildings],
        }
        for label, found in references.items():
            if all(found):
                runs = [pool_runs([*of.values()]) for of in found]
                yield from _ranking(f"{name}, {label}", harm_score(pool_stores(runs)))
    yield from _share_rows(buildings)


def _measure(path: Path, seed: int, views: int, kinds: Sequence[str]) -> Building:
    names = list(pretrained.PRETRAINED_MODELS)
    if not path.exists():
        _build(path, seed, views)
    precompute(path, QUIET, [*names, _UNTRAINED], PrecomputeOptions(tuple(kinds)))
    with s2rstore.open(path) as store:
        truth = GroundTruth(store)
        evaluated = open_runs(store, names)
        gains = measure_object_gains(truth, evaluated, views)
        own, foreign, untrained = {}, {}, {}
        for made in harm_report.kind_estimates(store, gains, seed):
            if made.side == "real":
                mode = made.kind, made.mode
                own[mode], foreign[mode] = (
                    {run: gains.pairs(run, e, made.in_metres) for run, e in estimates.items()}
                    for estimates in (made.of_run, made.of_other_run)
                )
                untrained[mode] = _untrained(store, gains, mode) if made.of_other_run else {}
        if Harm.name in kinds:
            for name, estimate in ((_STORED, _stored_gains), (_REAL_LABELS, _real_label_gains)):
                mode = name, None
                own[mode] = {
                    run: gains.pairs(run, estimate(store, gains, run), in_metres=True)
                    for run in gains.runs
                }
                foreign[mode], untrained[mode] = {}, {}
        true = measure_shares(truth, evaluated, min(SHARE_VIEWS, views))
        shares: dict[str, list[SharePair]] = {}
        for run in names:
            for name, guess in harm_report.share_estimates(store, true, run).items():
                shares.setdefault(name, []).append((true.shares[run], guess))
        return Building(seed, own, foreign, untrained, shares)


def _build(path: Path, seed: int, views: int) -> None:
    """A building with the pretrained models and one that was never trained."""
    from s2rtui.cli import main as s2r

    folder, store = path.parent, ("--store", str(path))
    untrained = folder / "untrained.safetensors"
    save_file({k: v.contiguous() for k, v in lively("resposenet").state_dict().items()}, untrained)
    weights = {name: pretrained.FOLDER / f"{name}.safetensors"
               for name in pretrained.PRETRAINED_MODELS}  # fmt: skip
    count = str(-(-views // 2))
    commands: list[tuple[str, ...]] = [
        ("ingest", "world", "--seed", str(seed), "--instances", count, *store)
    ]
    for name, file in {**weights, _UNTRAINED: untrained}.items():
        architecture = "resposenet"
        if name in pretrained.PRETRAINED_MODELS:
            architecture = str(pretrained.model_description(name)["architecture"])
        commands.append(("model", "add", name, str(file), "--arch", architecture, *store))
        commands.append(("run", "add", name, "--model", name, *store))
    with contextlib.redirect_stdout(sys.stderr):
        for command in commands:
            if s2r(list(command)):
                raise RuntimeError(f"s2r {' '.join(command)} failed")


def _untrained(store: Store, gains: ObjectGains, mode: Mode) -> dict[str, ScoredPairs]:
    """Gains of the trained runs beside the map of random weights."""
    in_metres = HEATMAP_KINDS[mode[0]].sums_to_metres
    maps = harm_report.heatmaps_of(store, _UNTRAINED, mode[0], "real", mode[1], gains.iids)
    return {
        run: gains.pairs(run, gains.estimates(run, "real", maps, in_metres), in_metres)
        for run in gains.runs
    }


def _stored_gains(store: Store, gains: ObjectGains, run: str) -> NDArray[np.float64]:
    """The stored gain (K,) of the object of each pair, 0 where its image does not show it."""
    query = "SELECT iid, label, gain FROM label_gain WHERE run = ?"
    known = {(iid, label): gain for iid, label, gain in store.execute(query, [run])}
    pairs = zip(gains.iids[gains.view].tolist(), gains.item.tolist(), strict=True)
    return np.array([known.get(pair, 0.0) for pair in pairs], dtype=np.float64)


def _real_label_gains(store: Store, gains: ObjectGains, run: str) -> NDArray[np.float64]:
    """The gain (K,) of each pair's object by the real label images, 0 where they do not show it."""
    nothing = np.zeros(gains.frame, dtype=np.uint16)
    found = np.zeros(gains.view.size)
    for view, iid in enumerate(gains.iids.tolist()):
        heat = store.heatmap(run, Harm.name, "real", iid, "position")
        of_labels = image_gains(heat, store.label_images("real", iid, iid + 1)[0], nothing)
        pairs = np.flatnonzero(gains.view == view)
        known = pairs[gains.item[pairs] < of_labels.size]
        found[known] = np.nan_to_num(of_labels[gains.item[known]])
    return found


def _share_rows(buildings: Sequence[Building]) -> Iterator[BudgetRow]:
    """Correlation of estimated and true shares over all buildings and runs, and of the weakest."""
    for estimator in buildings[0].shares:
        parts = [part for building in buildings for part in building.shares[estimator]]
        true, guess = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        for column, group in enumerate(FACTOR_GROUPS):
            name = f"share of {group}, {estimator}"
            least = _SHARE_BUDGETS.get(group) if estimator == "gap_shares" else None
            pooled = _pearson(true[:, column], guess[:, column])
            if np.isfinite(pooled):
                views = f"{name}, pooled, {len(true)} views"
                yield BudgetRow(views, pooled, "r", least, "at least")
                each = [_pearson(a[:, column], b[:, column]) for a, b in parts]
                yield BudgetRow("... weakest run of a building", min(each), "r")
            off = float(np.abs(true[:, column] - guess[:, column]).mean())
            yield BudgetRow(f"{name}, mean absolute error", off, "m")
        exact = float(np.abs(true.sum(axis=1) - guess.sum(axis=1)).max())
        yield BudgetRow(f"sum of the shares of {estimator} minus the gap", exact, "m", 1e-3)


def _pearson(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return weighted_pearson(a, b, np.ones(a.size))


def _ranking(
    name: str, score: HarmScore, auroc: float | None = None, correlation: float | None = None
) -> Iterator[BudgetRow]:
    yield BudgetRow(name, score.auroc.value, "AUROC", auroc, "at least")
    yield BudgetRow("... rank correlation", score.correlation.value, "rho", correlation, "at least")


def _weakest(
    name: str, scores: Sequence[HarmScore], auroc: float | None, correlation: float | None
) -> Iterator[BudgetRow]:
    """The lowest scores of any run in any building."""
    least = min((s.auroc.value for s in scores if np.isfinite(s.auroc.value)), default=np.nan)
    yield BudgetRow(name, least, "AUROC", auroc, "at least")
    known = [s.correlation.value for s in scores if np.isfinite(s.correlation.value)]
    least = min(known, default=np.nan)
    yield BudgetRow("... rank correlation", least, "rho", correlation, "at least")


def _name(mode: Mode) -> str:
    return " ".join(part for part in mode if part)


def _counts(score: HarmScore) -> str:
    interval = f"95 % {score.auroc.low:.2f} .. {score.auroc.high:.2f}"
    return f"{score.n} pairs in {score.views} views, {interval}"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.harm", description=__doc__)
    parser.add_argument("--seeds", default=",".join(map(str, SEEDS)), help="world seeds")
    parser.add_argument("--views", type=int, default=VIEWS, help="views of each building")
    parser.add_argument("--kinds", default=",".join(HEATMAP_KINDS), help="heatmap kinds")
    parser.add_argument("--folder", type=Path, help="keep the buildings here, and use them again")
    options = parser.parse_args()
    seeds = [int(seed) for seed in options.seeds.split(",")]
    with contextlib.ExitStack() as stack:
        folder = options.folder or stack.enter_context(tempfile.TemporaryDirectory())
        os.makedirs(folder, exist_ok=True)
        rows = list(figures(Path(folder), seeds, options.views, options.kinds.split(",")))
    for row in rows:
        budget = "" if row.budget is None else f"  {row.sense} {row.budget:g}"
        print(f"{row.name:<70} {row.value:6.3f} {row.unit}{budget}{'' if row.ok else '  OVER'}")
    return 1 if any(not row.ok for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
