"""Whether simulation ranks the runs of a store as reality does.

The intervals come from other instances of the same runs; they say nothing about other runs. Source:
Li et al., "Evaluating real-world robot manipulation policies in simulation" (SIMPLER), 2024, for
the mean maximum rank violation; Kadian et al., "Sim2Real predictivity", 2020, for the coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rstore.metrics import run_metrics
from s2rstore.metrics.bootstrap import Interval, percentile_interval
from s2rstore.reader import Store
from s2rtools.gap import blocks
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.bootstrap_correction import widened

Floats = NDArray[np.float64]

LEAST_RUNS = 5
LEAST_INSTANCES = 20
LEAST_BLOCKS = 4


@dataclass(frozen=True, slots=True)
class RankConsistency:
    """Mean errors `sim`, `real` (m) of `runs` over the same `n` instances, and how they agree.

    `correlation` is Pearson's, NaN where all runs have one error; `rank_violation` is in metres.
    """

    runs: tuple[str, ...]
    sim: tuple[float, ...]
    real: tuple[float, ...]
    n: int
    correlation: Interval
    rank_violation: Interval


def across(store: Store, iids: NDArray[np.int64], settings: GapSettings) -> RankConsistency:
    """Over the computed runs, on the selected instances that none of their models was trained on.

    Raises InconclusiveError below 5 runs and for too few common instances.
    """
    runs = [run.run for run in store.runs.values() if run.key is not None]
    if len(runs) < LEAST_RUNS:
        raise InconclusiveError(
            f"{store.path}: {len(runs)} computed runs; at least {LEAST_RUNS} are needed to tell "
            "whether simulation ranks them as reality does"
        )
    keep = np.zeros(len(store.instances), dtype=np.bool_)
    keep[iids] = True
    for run in runs:
        keep &= run_metrics.held_out(store, run)
    cut = blocks.cut(store.instances.trajectory[keep])
    n = int(keep.sum())
    if n < LEAST_INSTANCES or cut.count < LEAST_BLOCKS:
        raise InconclusiveError(
            f"{store.path}: {n} instances in {cut.count} blocks that no run's model was trained "
            f"on; at least {LEAST_INSTANCES} in {LEAST_BLOCKS} are needed"
        )
    columns = [store.run_columns(run) for run in runs]
    sim, sims = _means(np.stack([c.sim.error[keep] for c in columns], axis=1), cut, settings)
    real, reals = _means(np.stack([c.real.error[keep] for c in columns], axis=1), cut, settings)
    return RankConsistency(
        tuple(runs),
        tuple(sim[0].tolist()),
        tuple(real[0].tolist()),
        n,
        _interval(correlation(sim, real), correlation(sims, reals), settings.level),
        _interval(rank_violation(sim, real), rank_violation(sims, reals), settings.level),
    )


def correlation(sim: Floats, real: Floats) -> Floats:
    """Pearson's coefficient of each row of (R, runs), shape (R,); NaN without any spread."""
    a, b = (side - side.mean(axis=1, keepdims=True) for side in (sim, real))
    scale = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    small = 1e-12 * np.maximum(np.abs(sim).max(axis=1) * np.abs(real).max(axis=1), 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(scale > small, (a * b).sum(axis=1) / scale, np.nan)
    return np.asarray(np.clip(found, -1.0, 1.0))


def rank_violation(sim: Floats, real: Floats) -> Floats:
    """Mean maximum rank violation of each row of (R, runs), shape (R,), in the errors' unit.

    The violation of two runs is their real difference where sim orders them otherwise, else 0; the
    largest of each run is averaged over the runs.
    """
    wrong = (sim[:, :, None] < sim[:, None, :]) != (real[:, :, None] < real[:, None, :])
    apart = np.abs(real[:, :, None] - real[:, None, :])
    return np.asarray(np.where(wrong, apart, 0.0).max(axis=2).mean(axis=1))


def _means(errors: Floats, cut: blocks.Blocks, settings: GapSettings) -> tuple[Floats, Floats]:
    """Mean errors (1, runs) of (n, runs), and their replicates (R, runs)."""
    counts = blocks.draws(cut, settings.replicates, settings.seed)
    means = counts @ cut.sums(errors) / (counts @ cut.sizes)[:, None]
    value = errors.mean(axis=0)
    return value[None, :], widened(means, value, cut.drawn, settings.level)


def _interval(value: Floats, replicates: Floats, level: float) -> Interval:
    known = replicates[np.isfinite(replicates)]
    if not np.isfinite(value[0]) or not known.size:
        return Interval.unknown()
    return percentile_interval(value[0], known, level)
