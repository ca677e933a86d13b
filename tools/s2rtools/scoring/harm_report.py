"""Score every heatmap kind of computed runs, and the shares of the gap, against true gains."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from s2rstore.index.schema import GAP_SHARES
from s2rstore.intervals import Interval
from s2rstore.metrics.gap_shares import has_shares
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.scoring.factor_shares import (
    ALWAYS_LIGHTING,
    EVEN_SPLIT,
    LIGHTING,
    ShareScore,
    TrueShares,
    constant_answers,
    largest_share_named,
    score_shares,
)
from s2rtools.scoring.harm_metrics import HarmScore, ScoredPairs, harm_score, pool_runs
from s2rtools.scoring.object_gains import ObjectGains
from s2rtools.scoring.repair_curves import RepairErrors, RepairScore, repair_scores

POOLED = "all runs"
RANDOM, AREA = "random", "area"
"""Names of the baselines: a random estimate, and the object's number of pixels."""
_ROWS = 64

Floats = NDArray[np.float64]
ShareEstimator = Callable[[Store, str, NDArray[np.intp]], Floats | None]
"""Shares (n, groups) in metres of some instances for a run; None where they are not computed."""


def _stored_shares(store: Store, run: str, iids: NDArray[np.intp]) -> Floats | None:
    """The published shares of the gap."""
    if not has_shares(store, run):
        return None
    real = store.run_columns(run).real
    return np.stack([getattr(real, name)[iids] for name in GAP_SHARES], axis=1)


SHARE_ESTIMATORS: dict[str, ShareEstimator] = {"gap_shares": _stored_shares}
"""Estimators of the shares of the gap, by the name that the report prints."""


@dataclass(frozen=True, slots=True)
class KindScore:
    """Score of one kind's maps of one side: of a run, or pooled over `POOLED`.

    `in_metres` kinds estimate the gain of an object by the sum of their heat over its pixels, the
    others by the mean. `other_run` is the AUROC of another run's maps against this run's gains.
    """

    run: str
    kind: str
    mode: str | None
    side: Side
    in_metres: bool
    score: HarmScore
    other_run: Interval


@dataclass(frozen=True, slots=True)
class KindRepairs:
    """Repair curve of one kind's maps of the real side of a run."""

    run: str
    kind: str
    mode: str | None
    score: RepairScore


@dataclass(frozen=True, slots=True)
class LargestShare:
    """How often an estimator names the group with the largest share of the gap."""

    run: str
    estimator: str
    right: Interval
    n: int


@dataclass(slots=True)
class KindEstimates:
    """Estimates (K,) of all pairs from one kind's maps of one side, by run."""

    kind: str
    mode: str | None
    side: Side
    in_metres: bool
    of_run: dict[str, Floats] = field(default_factory=dict)
    of_other_run: dict[str, Floats] = field(default_factory=dict)

    def pairs(self, gains: ObjectGains) -> dict[str, ScoredPairs]:
        """Pairs by run, and all of them as `POOLED` where there are several runs."""
        made = {run: gains.pairs(run, e, self.in_metres) for run, e in self.of_run.items()}
        return made | {POOLED: pool_runs([*made.values()])} if len(made) > 1 else made


def kind_estimates(store: Store, gains: ObjectGains, seed: int) -> Iterator[KindEstimates]:
    """Estimates of the baselines, and of every heatmap kind and mode of either side."""
    sizes = {run: gains.pixels(run, "real").sum(axis=(1, 2)).astype(float) for run in gains.runs}
    rng = np.random.default_rng([seed, 5])
    noise = {run: rng.random(gains.view.size) for run in gains.runs}
    yield KindEstimates(RANDOM, None, "real", False, noise)
    yield KindEstimates(AREA, None, "real", False, sizes)
    for kind, mode in scored_modes(store, gains.runs):
        for side in SIDES:
            yield _estimates(store, gains, kind, mode, side)


def scored_modes(store: Store, runs: list[str]) -> list[tuple[str, str | None]]:
    """Kinds and modes of any run; of kinds with planes, `position`, else `loss`."""
    chosen: dict[tuple[str, str | None], None] = {}
    for run in runs:
        for record in store.array_kinds(run):
            if record.kind in HEATMAP_KINDS:
                planes = HEATMAP_KINDS[record.kind].planes
                mode = ("position" if "position" in planes else "loss") if planes else record.mode
                chosen[record.kind, mode] = None
    return sorted(chosen, key=lambda pair: (list(HEATMAP_KINDS).index(pair[0]), pair[1] or ""))


def kind_scores(gains: ObjectGains, estimates: KindEstimates) -> list[KindScore]:
    """Scores of one kind for each run and pooled."""
    pairs = estimates.pairs(gains)
    others = {
        run: gains.pairs(run, e, estimates.in_metres) for run, e in estimates.of_other_run.items()
    }
    if len(others) > 1:
        others[POOLED] = pool_runs([*others.values()])
    return [
        KindScore(
            run, estimates.kind, estimates.mode, estimates.side, estimates.in_metres,
            harm_score(made),
            harm_score(others[run]).auroc if run in others else Interval.unknown(),
        )
        for run, made in pairs.items()
    ]  # fmt: skip


def kind_repairs(repairs: RepairErrors, estimates: KindEstimates) -> list[KindRepairs]:
    """Repair curves of one kind for each run."""
    return [
        KindRepairs(run, estimates.kind, estimates.mode, score)
        for run, estimate in estimates.of_run.items()
        for score in repair_scores(repairs, run, estimate)
    ]


def share_estimates(store: Store, true: TrueShares, run: str) -> dict[str, Floats]:
    """Estimated shares (V, groups) of a run by estimator, the constant answers among them."""
    made = {name: estimator(store, run, true.iids) for name, estimator in SHARE_ESTIMATORS.items()}
    known = {name: estimate for name, estimate in made.items() if estimate is not None}
    return known | constant_answers(true, run)


def share_scores(store: Store, true: TrueShares) -> tuple[list[ShareScore], list[LargestShare]]:
    """Scores of all estimators of shares, for each run with new instances."""
    scores: list[ShareScore] = []
    largest: list[LargestShare] = []
    for run in true.shares:
        if not true.is_new[run].any():
            continue
        for name, estimate in share_estimates(store, true, run).items():
            scores += score_shares(true, run, name, estimate)
            if name != EVEN_SPLIT:
                named = np.argmax(estimate, axis=1)
                named = np.full_like(named, LIGHTING) if name == ALWAYS_LIGHTING else named
                right = largest_share_named(true, run, named)
                largest.append(LargestShare(run, name, right, int(true.is_new[run].sum())))
    return scores, largest


def heatmaps_of(
    store: Store, run: str, kind: str, side: Side, mode: str | None, iids: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Heatmaps (n, rows, columns) of some instances."""
    parts = []
    for start in range(0, len(store.instances), _ROWS):
        rows = iids[(iids >= start) & (iids < start + _ROWS)]
        if rows.size:
            block = store.heatmaps(run, kind, side, start, start + _ROWS, mode)
            parts.append(block[np.sort(rows) - start])
    order = np.argsort(np.argsort(iids))
    return np.concatenate(parts)[order]


def _estimates(
    store: Store, gains: ObjectGains, kind: str, mode: str | None, side: Side
) -> KindEstimates:
    method = HEATMAP_KINDS[kind]
    made = KindEstimates(kind, mode, side, method.sums_to_metres)
    maps: dict[str, NDArray[np.float32]] = {}
    for run in gains.runs:
        if (kind, mode) in scored_modes(store, [run]):
            maps[run] = heatmaps_of(store, run, kind, side, mode, gains.iids)
            made.of_run[run] = gains.estimates(run, side, maps[run], made.in_metres)
    names = list(maps)
    for run, other in zip(names, names[1:] + names[:1], strict=True):
        if run != other and not method.model_free:
            made.of_other_run[run] = gains.estimates(run, side, maps[other], made.in_metres)
    return made
