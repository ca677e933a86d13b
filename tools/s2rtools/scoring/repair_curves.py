"""Repair curves: error after restoring the objects of a view one by one, in some order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval, paired_difference
from s2rtools.common.blocks import evenly_spread
from s2rtools.scoring.counterfactual_errors import CounterfactualErrors, EvaluatedRuns
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.object_gains import ObjectGains

REPAIRS = 3
"""Most objects that are restored in a view."""
MOST_OBJECTS = 5
"""Most objects of a view that can be chosen: those with the most pixels in the real view."""
VIEWS = 60
"""Default number of views; every subset of their objects is rendered."""

Subset = frozenset[int]
"""Rows of pairs of `ObjectGains` whose objects are restored."""


@dataclass(frozen=True, slots=True, eq=False)
class RepairErrors:
    """Errors in metres of views with every subset of at most `REPAIRS` of their objects restored.

    `views` are rows of `gains.iids`. `errors` holds one dictionary per run and view.
    """

    gains: ObjectGains
    views: NDArray[np.intp]
    errors: Mapping[str, list[dict[Subset, float]]]


@dataclass(frozen=True, slots=True)
class RepairScore:
    """Mean error in metres over `n` views after `repairs` repairs in the order of some estimates.

    `random` is its mean over all orders, `best` that of the best order of each view, and `saved`
    the decrease of the error beyond that of random orders. In a view with fewer objects all are
    restored.
    """

    repairs: int
    error: float
    random: float
    best: float
    saved: Interval
    n: int


def measure_repairs(
    truth: GroundTruth, evaluated: EvaluatedRuns, gains: ObjectGains, views: int = VIEWS
) -> RepairErrors:
    """Render evenly spread views that show at least two objects with all subsets restored.

    Subsets of one object, and of none, are those of `gains`.
    """
    errors = CounterfactualErrors(truth, evaluated)
    candidates = _candidates(gains, errors.runs[0])
    several = np.flatnonzero([len(pairs) >= 2 for pairs in candidates])
    chosen = several[evenly_spread(several.size, views)]
    found: dict[str, list[dict[Subset, float]]] = {run: [] for run in errors.runs}
    for view in chosen:
        iid = gains.iids[view : view + 1]
        by_subset: dict[Subset, dict[str, float]] = {}
        for subset in _subsets(candidates[view]):
            if len(subset) < 2:
                by_subset[subset] = _single_errors(gains, int(view), subset)
                continue
            restored = {int(gains.item[pair]) for pair in subset}
            renderer = truth.data.world.renderer(errors.active, restored=restored)
            made = errors.of_views(renderer, truth.poses[iid], truth.numbers[iid])
            by_subset[subset] = {run: float(values[0]) for run, values in made.items()}
        for run in errors.runs:
            found[run].append({subset: made[run] for subset, made in by_subset.items()})
    return RepairErrors(gains, chosen, found)


def repair_scores(
    repairs: RepairErrors, run: str, estimate: NDArray[np.floating]
) -> list[RepairScore]:
    """Scores after 1, 2 ... repairs of a run's new views, in the order of estimates (K,).

    Equal estimates, and unknown ones, which come last, keep the order of their objects.
    """
    gains = repairs.gains
    rows = [row for row, view in enumerate(repairs.views) if gains.is_new[run][view]]
    if not rows:
        return []
    curves = np.array([
        (_curve(errors, _ranked(errors, estimate)), _random_curve(errors), _best_curve(errors))
        for errors in (repairs.errors[run][row] for row in rows)
    ])  # fmt: skip
    trajectory = gains.trajectory[repairs.views[rows]]
    scores = []
    for count in range(1, REPAIRS + 1):
        own, random, best = curves[:, :, count].T
        saved = paired_difference(random - own, trajectory)
        error, by_chance, least = (float(values.mean()) for values in (own, random, best))
        scores.append(RepairScore(count, error, by_chance, least, saved, len(rows)))
    return scores


def _candidates(gains: ObjectGains, run: str) -> list[list[int]]:
    """Pairs of each view whose objects can be restored, those with the most pixels."""
    sizes = gains.pixels(run, "real").sum(axis=(1, 2))
    found: list[list[int]] = [[] for _ in gains.iids]
    for pair in np.argsort(-sizes, kind="stable"):
        if len(found[gains.view[pair]]) < MOST_OBJECTS:
            found[gains.view[pair]].append(int(pair))
    return [sorted(pairs) for pairs in found]


def _subsets(pairs: list[int]) -> Iterator[Subset]:
    for count in range(min(REPAIRS, len(pairs)) + 1):
        yield from map(frozenset, combinations(pairs, count))


def _single_errors(gains: ObjectGains, view: int, subset: Subset) -> dict[str, float]:
    return {
        run: float(gains.before[run][view] - sum(gains.gain[run][pair] for pair in subset))
        for run in gains.runs
    }


def _objects(errors: dict[Subset, float]) -> list[int]:
    return sorted(set().union(*errors))


def _ranked(errors: dict[Subset, float], estimate: NDArray[np.floating]) -> list[int]:
    pairs = np.array(_objects(errors))
    values = np.asarray(estimate, dtype=np.float64)[pairs]
    return pairs[np.argsort(np.where(np.isfinite(values), -values, np.inf), kind="stable")].tolist()


def _curve(errors: dict[Subset, float], order: list[int]) -> list[float]:
    """Errors after 0 .. `REPAIRS` repairs in an order."""
    return [errors[frozenset(order[: min(count, len(order))])] for count in range(REPAIRS + 1)]


def _random_curve(errors: dict[Subset, float]) -> list[float]:
    """Mean over all orders: the mean over all subsets of each size."""
    most = len(_objects(errors))
    return [
        float(np.mean([e for subset, e in errors.items() if len(subset) == min(count, most)]))
        for count in range(REPAIRS + 1)
    ]


def _best_curve(errors: dict[Subset, float]) -> list[float]:
    """The curve with the smallest sum over all orders."""
    pairs = _objects(errors)
    orders = permutations(pairs, min(REPAIRS, len(pairs)))
    return min((_curve(errors, list(order)) for order in orders), key=sum)
