"""Rank consistency: whether simulation ranks the runs of a store in the same order as reality.

The regret is what choosing a run by simulation costs in reality; its interval is about these runs.
The rank correlation has an interval about other runs like these where there are enough runs. The
mean maximum rank violation has the size that instances show which did not choose the violations,
so that noise in the real errors does not count as violation: it may be below 0. Noise in the sim
errors does count, and violations between runs that are close are found too small.

Source: Li et al., "Evaluating real-world robot manipulation policies in simulation" (SIMPLER),
2024, for the mean maximum rank violation; Kadian et al., "Sim2Real predictivity", 2020, for the
correlation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from s2rstore.errors import InconclusiveError
from s2rstore.intervals import MIN_DIFFERENCE, MIN_SHARE, Interval, paired_difference, spearman
from s2rstore.intervals.verdict import Bounds, largest
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.gap.axis import GapSettings

Floats = NDArray[np.float64]

MIN_RUNS = 5
_FOLDS = 5


@dataclass(frozen=True, slots=True)
class RankConsistency:
    """Mean errors `sim` and `real` (m) of `runs` on the same `n` instances, and their agreement.

    spearman, kendall, pearson: correlations of the mean errors, NaN where all runs have the same
    error. chosen: the run that simulation ranks first; best: the one that reality does. regret:
    real error of the chosen run minus that of the best, m. rank_violation: in m. rooms: the same
    within each room of enough instances.
    """

    runs: tuple[str, ...]
    sim: tuple[float, ...]
    real: tuple[float, ...]
    n: int
    spearman: Interval
    kendall: float
    pearson: float
    chosen: str
    best: str
    regret: Interval
    rank_violation: float
    rooms: dict[str, RankConsistency] = field(default_factory=dict)

    @property
    def scope(self) -> str:
        """What the rank correlation is about; all other figures are about these runs only."""
        return "runs like these" if self.spearman.is_known else "these runs only"

    def as_json(self) -> dict[str, Any]:
        """The comparison as JSON data."""
        runs = zip(self.runs, self.sim, self.real, strict=True)
        return {
            "runs": [{"run": run, "sim": sim, "real": real} for run, sim, real in runs],
            "n": self.n,
            "scope": self.scope,
            "pearson": self.pearson,
            "kendall": self.kendall,
            **self.spearman.as_columns("spearman"),
            "chosen_run": self.chosen,
            "best_run": self.best,
            **self.regret.as_columns("regret"),
            "mmrv": self.rank_violation,
            "rooms": {room: within.as_json() for room, within in self.rooms.items()},
        }


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
        common &= run_metrics.population(store, run)
    rows = store.in_recording_order(common)
    if rows.size < MIN_DIFFERENCE:
        raise InconclusiveError(
            f"{store.path}: {rows.size} instances that no run's model was trained on; at least "
            f"{MIN_DIFFERENCE} are needed"
        )
    columns = [store.run_columns(run) for run in runs]
    sims, reals = (
        np.stack([getattr(each, side).error[rows] for each in columns], axis=1) for side in SIDES
    )
    places, names = store.instances.room[rows], store.instances.room_names
    trajectory, level = store.instances.trajectory[rows], settings.level
    rooms = {
        names[code]: _compare(tuple(runs), sims[inside], reals[inside], trajectory[inside], level)
        for code in np.unique(places[places >= 0])
        if np.count_nonzero(inside := places == code) >= MIN_DIFFERENCE
    }
    return replace(_compare(tuple(runs), sims, reals, trajectory, level), rooms=rooms)


def _compare(
    runs: tuple[str, ...], sims: Floats, reals: Floats, trajectory: NDArray[np.integer],
    level: float,
) -> RankConsistency:  # fmt: skip
    """Compare the errors (n, runs) of the same instances in recording order."""
    sim, real = sims.mean(axis=0), reals.mean(axis=0)
    chosen = int(np.argmin(sim))
    return RankConsistency(
        runs=runs,
        sim=tuple(sim.tolist()),
        real=tuple(real.tolist()),
        n=len(reals),
        spearman=_rank_correlation(sim, real, level),
        kendall=_correlation(stats.kendalltau, sim, real),
        pearson=_correlation(stats.pearsonr, sim, real),
        chosen=runs[chosen],
        best=runs[int(np.argmin(real))],
        regret=regret(reals, chosen, trajectory, level),
        rank_violation=rank_violation(sims, reals),
    )


def regret(real: Floats, chosen: int, trajectory: NDArray[np.integer], level: float) -> Interval:
    """Mean real error of the chosen run minus that of the best of the runs, in metres.

    `real` (n, runs) are errors of the same instances in recording order. At least 0.
    """

    def excess_over(other: int) -> Bounds:
        difference = real[:, chosen] - real[:, other]
        return lambda level: paired_difference(difference, trajectory, level=level)

    return largest(map(excess_over, range(real.shape[1])), level).at_least(0.0)


def rank_violation(sim: Floats, real: Floats) -> float:
    """Mean maximum rank violation of errors (n, runs) in recording order, in their unit.

    The violation of two runs is the difference of their mean real errors where sim ranks them the
    other way round, else 0; the largest violation of each run is averaged over the runs. Each fifth
    of the instances gives the size of those violations that the other instances choose.
    """
    folds = np.arange(len(real)) * _FOLDS // len(real)
    found = []
    for fold in range(_FOLDS):
        left_out = folds == fold
        sims, reals = sim[~left_out].mean(axis=0), real[~left_out].mean(axis=0)
        order = np.sign(reals[:, None] - reals[None, :])
        wrong = (sims[:, None] < sims[None, :]) != (order < 0)
        distance = np.where(wrong, np.abs(reals[:, None] - reals[None, :]), 0.0)
        run, worst = np.arange(len(sims)), distance.argmax(axis=1)
        held_out = real[left_out].mean(axis=0)
        size = order[run, worst] * (held_out - held_out[worst])
        found.append(np.where(distance[run, worst] > 0, size, 0.0).mean())
    return float(np.mean(found))


def _rank_correlation(sim: Floats, real: Floats, level: float) -> Interval:
    value = _correlation(stats.spearmanr, sim, real)
    if np.isnan(value):
        return Interval.unknown(value, "all runs have the same mean error")
    if sim.size < MIN_SHARE:
        return Interval.unknown(value, f"{sim.size} runs, a correlation needs {MIN_SHARE}")
    return spearman(sim, real, np.arange(sim.size), level=level)


def _correlation(of: object, sim: Floats, real: Floats) -> float:
    if np.ptp(sim) == 0 or np.ptp(real) == 0:
        return float("nan")
    return float(of(sim, real).statistic)  # type: ignore[operator]
