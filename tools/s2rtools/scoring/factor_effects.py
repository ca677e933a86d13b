"""Counterfactual pose errors: with each factor alone, without each, and per changed object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval, mean, of_units, paired_difference, simultaneous_level
from s2rstore.metrics import run_metrics
from s2rtools.common.blocks import evenly_spread
from s2rtools.scoring.counterfactual_errors import (
    CounterfactualErrors,
    Errors,
    EvaluatedRuns,
    Factors,
)
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.synthetic_world.factors import FACTORS
from s2rtools.synthetic_world.renderer import SceneRenderer
from s2rtools.synthetic_world.world import labelled_changes

SEARCHED_POSES = 240
"""Poses along each route that are searched for views of an object."""
MIN_SHARE = 0.004
"""Share of a view's pixels from which an object counts as visible."""
MIN_VIEWS = 5
MAX_VIEWS = 12
_SEARCH_FRAME = 32
_SEED_OFFSET = 100_000_000


@dataclass(frozen=True, slots=True)
class FactorScore:
    """Real error in metres with one factor alone and with all others, over `n` instances.

    `cost` is the increase of the error from no factor to this factor alone; `gain` is the decrease
    from all factors to all but this one. The intervals of each hold for all factors of the run at
    once. `left_out` counts the excluded training instances.
    """

    run: str
    factor: str
    alone: Interval
    without: Interval
    alone_median: float
    without_median: float
    cost: Interval
    gain: Interval
    n: int
    left_out: int


@dataclass(frozen=True, slots=True)
class ObjectScore:
    """Decrease of the real error in metres when one changed object is restored.

    Averaged over at most `MAX_VIEWS` views of it along the routes; fewer than `MIN_VIEWS` views
    have no interval.
    """

    run: str
    object: int
    name: str
    change: str
    gain: Interval
    n: int


class Counterfactuals:
    """Effects of the world's factors and of its changed objects on the runs' real errors."""

    def __init__(self, truth: GroundTruth, evaluated: EvaluatedRuns, instances: int) -> None:
        self._truth, self._errors = truth, CounterfactualErrors(truth, evaluated)
        n = len(truth.poses)
        self.iids = truth.store.in_recording_order(np.arange(n))[evenly_spread(n, instances)]
        self.active = self._errors.active

    def factor_scores(self) -> list[FactorScore]:
        """Scores of each active factor for each run with held-out instances."""
        names = [n for n, f in FACTORS.items() if n in self.active and not f.moves_robot]
        conditions: dict[str, Factors] = {"none": {}, "all": self.active}
        for name in names:
            conditions[f"only {name}"] = {name: self.active[name]}
            conditions[f"no {name}"] = {k: v for k, v in self.active.items() if k != name}
        errors = self.errors(conditions)
        level = simultaneous_level(len(names))
        scores = []
        for run in self._errors.runs:
            fresh = run_metrics.population(self._truth.store, run)[self.iids]
            if not fresh.any():
                continue
            trajectory = self._truth.store.instances.trajectory[self.iids][fresh]
            of = {label: made[run][fresh] for label, made in errors.items()}
            for name in names:
                alone, without = of[f"only {name}"], of[f"no {name}"]
                scores.append(
                    FactorScore(
                        run, name, mean(alone, trajectory),
                        mean(without, trajectory),
                        float(np.median(alone)), float(np.median(without)),
                        paired_difference(alone - of["none"], trajectory, level=level),
                        paired_difference(of["all"] - without, trajectory, level=level),
                        int(fresh.sum()), int((~fresh).sum()),
                    )
                )  # fmt: skip
        return scores

    def errors(self, conditions: Mapping[str, Factors]) -> dict[str, Errors]:
        """Position errors (n,) in metres of `iids` by condition and run."""
        return self._errors.of_instances(self.iids, conditions)

    def object_scores(self) -> list[ObjectScore]:
        """Scores of restoring each labelled object to its simulated state, with all else unchanged.

        Only for runs whose model was trained on none of the store's instances, because the views
        lie between them.
        """
        changes = {item["object"]: item for item in labelled_changes(self._truth.data.world)}
        store, names = self._truth.store, self._errors.runs
        fresh = [name for name in names if run_metrics.population(store, name).all()]
        scores = []
        for number, before, after in self._restored():
            name, change = changes[number]["name"], changes[number]["change"]
            for run in fresh:
                gain = before[run] - after[run]
                mean = _mean_of_views(gain)
                scores.append(ObjectScore(run, number, name, change, mean, gain.size))
        return sorted(scores, key=lambda score: (names.index(score.run), score.object))

    def _restored(self) -> Iterator[tuple[int, Errors, Errors]]:
        """Per visible object: errors on the same views before and after restoring it."""
        data = self._truth.data
        poses = np.concatenate([data.world.poses(name, SEARCHED_POSES) for name in data.names])
        views = self._views_of_objects(poses)
        if not views:
            return
        used = np.unique(np.concatenate(list(views.values())))
        before = self._on_views(data.renderer("real"), used, poses)
        for number, rows in views.items():
            places = np.searchsorted(used, rows)
            restored = data.world.renderer(self.active, restored=(number,))
            after = self._on_views(restored, rows, poses)
            yield number, {run: errors[places] for run, errors in before.items()}, after

    def _on_views(
        self, renderer: SceneRenderer, rows: NDArray[np.intp], poses: NDArray[np.float64]
    ) -> Errors:
        return self._errors.of_views(renderer, poses[rows], _SEED_OFFSET + rows)

    def _views_of_objects(self, poses: NDArray[np.float64]) -> dict[int, NDArray[np.intp]]:
        """Rows of `poses` whose views show each labelled object in either scene, evenly spread."""
        data = self._truth.data
        camera = data.camera_with(self.active, _SEARCH_FRAME)
        shares = np.zeros((len(self._truth.changed), len(poses)))
        for start in range(0, len(poses), 256):
            span = slice(start, start + 256)
            ids = [data.renderer(scene).render(poses[span], camera, samples=0).identity
                   for scene in ("sim", "real")]  # fmt: skip
            for place, number in enumerate(self._truth.changed):
                visible = (ids[0] == number) | (ids[1] == number)
                shares[place, span] = visible.mean(axis=(1, 2))
        found = {}
        for number, share in zip(self._truth.changed, shares, strict=True):
            rows = np.flatnonzero(share >= MIN_SHARE)
            if rows.size:
                found[number] = rows[evenly_spread(rows.size, MAX_VIEWS)]
        return found


def _mean_of_views(values: NDArray[np.float64]) -> Interval:
    """Mean over views that are not neighbours; too few views have no interval."""
    value, n = float(values.mean()), values.size
    if n < MIN_VIEWS:
        return Interval.unknown(value, f"{n} views, a mean needs {MIN_VIEWS}")
    return of_units(value, (values.sum() - values) / (n - 1), unit="views")
