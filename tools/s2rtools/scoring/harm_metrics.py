"""Score estimates of harm against true gains: rank correlation, AUROC, and claims in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval, of_rows
from s2rtools.scoring.statistics import weighted_mean, weighted_pearson

HARMFUL = 0.25
"""Metres from which a gain counts as harm, and an estimate as a claim of harm."""
MIN_COUNT = 8
"""Harmful pairs below which scores have no interval, and claims below which their scores have none.
"""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ScoredPairs:
    """True gains (K,) in metres beside estimates (K,) of any unit, for pairs of view and object.

    An unknown estimate is NaN; it ranks as the median of the known ones. `view` (K,) are rows of
    `trajectory` (V,), the codes of the views' trajectories in recording order, equal ones adjacent.
    """

    gain: Floats
    estimate: Floats
    view: NDArray[np.intp]
    trajectory: NDArray[np.intp]
    in_metres: bool = False


@dataclass(frozen=True, slots=True)
class HarmScore:
    """Agreement of estimates with true gains, over `n` pairs in `views` views.

    `correlation` is Spearman's, `auroc` that for gains above `HARMFUL`; both NaN where undefined.
    Of estimates in metres above `HARMFUL`, the `claims`: `precision` is the share with such a gain,
    `delivered` their mean gain in metres. `base_rate` and `mean_gain` are those of random claims.
    Intervals are over the views.
    """

    correlation: Interval
    auroc: Interval
    claims: int
    precision: Interval
    delivered: Interval
    base_rate: float
    mean_gain: float
    n: int
    views: int


def harm_score(pairs: ScoredPairs) -> HarmScore:
    """Score of the estimates of some pairs."""
    estimate = _known(pairs.estimate)
    claimed = (pairs.estimate > HARMFUL) & pairs.in_metres
    codes = [np.unique(values, return_inverse=True)[1] for values in (pairs.gain, estimate)]

    def statistics(weights: Floats) -> list[float]:
        return [
            weighted_correlation(codes[0], codes[1], weights),
            weighted_auroc(pairs.gain > HARMFUL, codes[1], weights),
            weighted_mean(pairs.gain > HARMFUL, weights * claimed),
            weighted_mean(pairs.gain, weights * claimed),
        ]

    if int((pairs.gain > HARMFUL).sum()) >= MIN_COUNT:
        found = of_rows(lambda views: statistics(views[pairs.view]), pairs.trajectory)
    else:
        few = f"fewer than {MIN_COUNT} harmful pairs"
        values = statistics(np.ones(pairs.gain.size))
        found = [Interval.unknown(value, few) for value in values]
    correlation, auroc, *of_claims = found
    if claimed.sum() < MIN_COUNT:
        few = f"fewer than {MIN_COUNT} claims"
        of_claims = [Interval.unknown(each.value, few) for each in of_claims]
    precision, delivered = of_claims
    return HarmScore(
        correlation.clipped(-1, 1), auroc.clipped(0, 1), int(claimed.sum()),
        precision.clipped(0, 1), delivered, weighted_mean(pairs.gain > HARMFUL),
        weighted_mean(pairs.gain), pairs.gain.size, np.unique(pairs.view).size,
    )  # fmt: skip


def pool_runs(parts: Sequence[ScoredPairs]) -> ScoredPairs:
    """Pairs of several runs on the same views as one.

    Estimates that are not in metres are divided by their deviation within each run, because their
    scale differs between networks.
    """
    scaled = [part.estimate if part.in_metres else _scaled(part.estimate) for part in parts]
    return replace(
        parts[0],
        gain=np.concatenate([part.gain for part in parts]),
        estimate=np.concatenate(scaled),
        view=np.concatenate([part.view for part in parts]),
    )


def pool_stores(parts: Sequence[ScoredPairs]) -> ScoredPairs:
    """Pairs of several stores as one; their views and trajectories are all different.

    Estimates are scaled as in `pool_runs`.
    """
    views = np.cumsum([0, *(part.trajectory.size for part in parts)])
    codes = np.cumsum([0, *(int(part.trajectory.max(initial=-1)) + 1 for part in parts)])
    moved = [
        replace(part, view=part.view + first, trajectory=part.trajectory + code)
        for part, first, code in zip(parts, views[:-1], codes[:-1], strict=True)
    ]
    trajectory = np.concatenate([part.trajectory for part in moved])
    return replace(pool_runs(moved), trajectory=trajectory)


def weighted_ranks(codes: NDArray[np.intp], weights: Floats) -> Floats:
    """Mean ranks (K,) of values with dense rank codes 0, 1, ..., each `weights` times present."""
    total = np.bincount(codes, weights)
    return np.asarray((np.cumsum(total) - total + (total + 1) / 2)[codes])


def weighted_correlation(a: NDArray[np.intp], b: NDArray[np.intp], weights: Floats) -> float:
    """Spearman's rank correlation of values given by their rank codes; NaN for constants."""
    return weighted_pearson(weighted_ranks(a, weights), weighted_ranks(b, weights), weights)


def weighted_auroc(positive: NDArray[np.bool_], codes: NDArray[np.intp], weights: Floats) -> float:
    """Probability that a positive ranks above a negative, ties counting half; NaN without either.

    Source: Mann and Whitney, 1947.
    """
    count, others = float(weights[positive].sum()), float(weights[~positive].sum())
    if not count or not others:
        return float("nan")
    ranks = (weights * weighted_ranks(codes, weights))[positive].sum()
    return float((ranks - count * (count + 1) / 2) / (count * others))


def _known(estimate: Floats) -> Floats:
    known = np.isfinite(estimate)
    return np.where(known, estimate, np.median(estimate[known]) if known.any() else 0.0)


def _scaled(estimate: Floats) -> Floats:
    spread = float(np.std(estimate[np.isfinite(estimate)])) if estimate.size else 0.0
    return estimate / spread if spread > 0 else estimate
