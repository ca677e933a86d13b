"""Rank consistency: whether simulation ranks the runs of a store in the same order as reality.

The intervals resample the instances of these runs; they do not generalise to other runs. Source:
Li et al., "Evaluating real-world robot manipulation policies in simulation" (SIMPLER), 2024, for
the mean maximum rank violation; Kadian et al., "Sim2Real predictivity", 2020, for the coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rstore.metrics import run_metrics
from s2rstore.metrics.bootstrap import (
    Interval,
    mean_replicates,
    percentile_interval,
    split_into_blocks,
)
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.gap.axis_result import GapSettings

Floats = NDArray[np.float64]

MIN_RUNS = 5
MIN_INSTANCES = 20
MIN_BLOCKS = 4


@dataclass(frozen=True, slots=True)
class RankConsistency:
    """Mean errors `sim` and `real` (m) of `runs` on the same `n` instances, and their agreement.

    `correlation` is Pearson's, NaN where all runs have the same error; `rank_violation` is in m.
    """

    runs: tuple[str, ...]
    sim: tuple[float, ...]
    real: tuple[float, ...]
    n: int
    correlation: Interval
    rank_violation: Interval


def rank_consistency(
    store: Store, iids: NDArray[np.int64], settings: GapSettings
) -> RankConsistency:
    """Compare the computed runs on selected instances that none of their models was trained on.

    Raises InconclusiveError for fewer than 5 runs and for too few common instances.
    """
    runs = [run.run for run in store.runs.values() if run.key is not None]
    if len(runs) < MIN_RUNS:
        raise InconclusiveError(
            f"{store.path}: {len(runs)} computed runs; at least {MIN_RUNS} are needed to "
            "compare their ranking in simulation and reality"
        )
    common = np.zeros(len(store.instances), dtype=np.bool_)
    common[iids] = True
    for run in runs:
        common &= run_metrics.held_out(store, run)
    chosen = store.in_recording_order(common)
    blocks = split_into_blocks(store.instances.trajectory[chosen])
    n = chosen.size
    if n < MIN_INSTANCES or blocks.count < MIN_BLOCKS:
        raise InconclusiveError(
            f"{store.path}: {n} instances in {blocks.count} blocks that no run's model was trained "
            f"on; at least {MIN_INSTANCES} in {MIN_BLOCKS} are needed"
        )
    columns = [store.run_columns(run) for run in runs]
    sides = (np.stack([getattr(c, s).error[chosen] for c in columns], axis=1) for s in SIDES)
    (sim, sims), (real, reals) = (
        (errors.mean(axis=0)[None, :], mean_replicates(errors, blocks, settings))
        for errors in sides
    )
    return RankConsistency(
        tuple(runs),
        tuple(sim[0].tolist()),
        tuple(real[0].tolist()),
        n,
        _interval(correlation(sim, real), correlation(sims, reals), settings.level),
        _interval(rank_violation(sim, real), rank_violation(sims, reals), settings.level),
    )


def correlation(sim: Floats, real: Floats) -> Floats:
    """Pearson correlation of each row of (R, runs), shape (R,); NaN where a row is constant."""
    a, b = (side - side.mean(axis=1, keepdims=True) for side in (sim, real))
    scale = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    small = 1e-12 * np.maximum(np.abs(sim).max(axis=1) * np.abs(real).max(axis=1), 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(scale > small, (a * b).sum(axis=1) / scale, np.nan)
    return np.asarray(np.clip(ratio, -1.0, 1.0))


def rank_violation(sim: Floats, real: Floats) -> Floats:
    """Mean maximum rank violation of each row of (R, runs), shape (R,), in the unit of the errors.

    The violation of two runs is the difference of their real errors where sim ranks them the other
    way round, else 0; the largest violation of each run is averaged over the runs.
    """
    wrong = (sim[:, :, None] < sim[:, None, :]) != (real[:, :, None] < real[:, None, :])
    distance = np.abs(real[:, :, None] - real[:, None, :])
    return np.asarray(np.where(wrong, distance, 0.0).max(axis=2).mean(axis=1))


def _interval(value: Floats, replicates: Floats, level: float) -> Interval:
    known = replicates[np.isfinite(replicates)]
    if not np.isfinite(value[0]) or not known.size:
        return Interval.unknown()
    return percentile_interval(value[0], known, level)
