"""True shares of the gap: exact Shapley values of the groups of factors, from all coalitions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval, mean, of_rows, proportion
from s2rstore.metrics import run_metrics
from s2rtools.common.blocks import evenly_spread
from s2rtools.common.shapley import shapley_values
from s2rtools.scoring.counterfactual_errors import CounterfactualErrors, EvaluatedRuns, Factors
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.statistics import weighted_pearson
from s2rtools.synthetic_world.factors import FACTOR_GROUPS, FACTORS

LIGHTING = FACTOR_GROUPS.index("lighting")
ALWAYS_LIGHTING, EVEN_SPLIT = "always lighting", "even split"

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TrueShares:
    """Metres that each group of factors adds to the real error of V views.

    `iids` (V,) are in recording order, `trajectory` (V,) their codes. By run: `shares` (V, groups)
    in the order of `FACTOR_GROUPS`, whose sum is `gap` (V,), the error with all factors minus that
    without any; `is_new` (V,) tells whether the instance is new to the run.
    """

    iids: NDArray[np.intp]
    trajectory: NDArray[np.intp]
    shares: Mapping[str, Floats]
    gap: Mapping[str, Floats]
    is_new: Mapping[str, NDArray[np.bool_]]


@dataclass(frozen=True, slots=True)
class ShareScore:
    """Agreement of estimated with true shares of one group over `n` instances.

    `correlation` is Pearson's, unknown where either is constant; `error` is the mean absolute
    difference in metres, `mean` the mean true share. `left_out` counts trained instances.
    """

    run: str
    estimator: str
    group: str
    correlation: Interval
    error: Interval
    mean: float
    n: int
    left_out: int


def measure_shares(truth: GroundTruth, evaluated: EvaluatedRuns, instances: int) -> TrueShares:
    """Render at most `instances` evenly spread real views with every coalition of the groups.

    A group without an active factor has the share 0.
    """
    errors, store = CounterfactualErrors(truth, evaluated), truth.store
    is_new = {run: run_metrics.population(store, run) for run in errors.runs}
    rows = store.in_recording_order(np.any(list(is_new.values()), axis=0))
    iids = np.asarray(rows[evenly_spread(len(rows), instances)], dtype=np.intp)
    members = _active_groups(errors.active)
    coalitions: dict[str, Factors] = {
        str(number): {
            name: severity
            for bit, factors in enumerate(members.values()) if number >> bit & 1
            for name, severity in factors.items()
        }
        for number in range(1 << len(members))
    }  # fmt: skip
    found = errors.of_instances(iids, coalitions)
    shares, gap = {}, {}
    for run in errors.runs:
        values = np.stack([found[name][run] for name in coalitions])
        gap[run] = values[-1] - values[0]
        shares[run] = np.zeros((len(iids), len(FACTOR_GROUPS)))
        if members:
            columns = [FACTOR_GROUPS.index(group) for group in members]
            shares[run][:, columns] = shapley_values(values).T
    trajectory = store.instances.trajectory[iids].astype(np.intp)
    return TrueShares(
        iids, trajectory, shares, gap, {run: mask[iids] for run, mask in is_new.items()}
    )


def constant_answers(true: TrueShares, run: str) -> dict[str, Floats]:
    """Shares (V, groups) of estimators that look at nothing but the gap."""
    gap, count = true.gap[run][:, None], len(FACTOR_GROUPS)
    lighting = np.zeros((1, count))
    lighting[0, LIGHTING] = 1.0
    return {ALWAYS_LIGHTING: gap * lighting, EVEN_SPLIT: gap * np.full((1, count), 1 / count)}


def score_shares(
    true: TrueShares, run: str, estimator: str, estimate: NDArray[np.floating]
) -> list[ShareScore]:
    """Scores of estimated shares (V, groups) in metres, by group, over the run's new instances."""
    new = true.is_new[run]
    if np.shape(estimate) != true.shares[run].shape:
        raise ValueError(f"shares of shape {np.shape(estimate)}, not {true.shares[run].shape}")
    trajectory = true.trajectory[new]
    scores = []
    for column, group in enumerate(FACTOR_GROUPS):
        actual = true.shares[run][new, column]
        guessed = np.asarray(estimate, dtype=np.float64)[new, column]
        (correlation,) = of_rows(partial(_correlation, actual, guessed), trajectory)
        scores.append(
            ShareScore(
                run, estimator, group, correlation.clipped(-1, 1),
                mean(np.abs(actual - guessed), trajectory), float(actual.mean()),
                int(new.sum()), int((~new).sum()),
            )
        )  # fmt: skip
    return scores


def largest_share_named(true: TrueShares, run: str, named: NDArray[np.intp]) -> Interval:
    """Share of the run's new instances in which the `named` group (V,) has the largest share."""
    new = true.is_new[run]
    right = np.argmax(true.shares[run][new], axis=1) == named[new]
    return proportion(right, true.trajectory[new])


def _correlation(a: Floats, b: Floats, weights: Floats) -> list[float]:
    return [weighted_pearson(a, b, weights)]


def _active_groups(active: Factors) -> dict[str, dict[str, float]]:
    """Severities of the active factors of each group that has any."""
    groups: dict[str, dict[str, float]] = {}
    for group in FACTOR_GROUPS:
        members = {name: value for name, value in active.items() if FACTORS[name].group == group}
        if members:
            groups[group] = members
    return groups
