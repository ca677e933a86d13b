"""Counterfactual pose errors: with each factor alone, without each, and per changed object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.metrics import run_metrics
from s2rstore.metrics.bootstrap import BootstrapSettings, Interval, mean_interval
from s2rstore.records import Run
from s2rtools.adjustments import apply_chain
from s2rtools.inference import Backend
from s2rtools.models.preprocessing import preprocess
from s2rtools.scoring.ground_truth import GroundTruth, move_camera
from s2rtools.synthetic_world.factors import FACTORS
from s2rtools.synthetic_world.renderer import RenderedViews, SceneRenderer
from s2rtools.synthetic_world.world import apply_sensor_factors, labelled_changes, side_camera

SEARCHED_POSES = 240
"""Poses along each route that are searched for views of an object."""
MIN_SHARE = 0.004
"""Share of a view's pixels from which an object counts as visible."""
MIN_VIEWS = 5
MAX_VIEWS = 12
_SEARCH_FRAME = 32
_BATCH = 32
_SEED_OFFSET = 100_000_000

Factors = Mapping[str, float]
EvaluatedRuns = Sequence[tuple[Run, Backend]]
Errors = dict[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class FactorScore:
    """Real error in metres with one factor alone and with all others, over `n` instances.

    `cost` is the increase of the error from no factor to this factor alone; `gain` is the decrease
    from all factors to all but this one. `left_out` counts the excluded training instances.
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
    """Errors of runs on counterfactual views of the world; all runs share each rendering."""

    def __init__(self, truth: GroundTruth, evaluated: EvaluatedRuns, instances: int) -> None:
        self._truth, self._evaluated = truth, evaluated
        n = len(truth.poses)
        rows = np.unique(np.linspace(0, n - 1, min(n, instances)).astype(int))
        self.iids = truth.store.in_recording_order(np.arange(n))[rows]
        self.active = {k: v for k, v in truth.data.severities("real").items() if v > 0}
        self._renderers: dict[tuple[object, ...], SceneRenderer] = {}
        self._by_move: dict[RigOffset, list[tuple[Run, Backend]]] = {}
        for run, backend in evaluated:
            self._by_move.setdefault(truth.camera_moves(run.run)["real"], []).append((run, backend))

    def factor_scores(self) -> list[FactorScore]:
        """Scores of each active factor for each run with held-out instances."""
        names = [n for n, f in FACTORS.items() if n in self.active and not f.moves_robot]
        conditions: dict[str, Factors] = {"none": {}, "all": self.active}
        for name in names:
            conditions[f"only {name}"] = {name: self.active[name]}
            conditions[f"no {name}"] = {k: v for k, v in self.active.items() if k != name}
        errors = self.errors(conditions)
        scores = []
        for run, _ in self._evaluated:
            fresh = run_metrics.held_out(self._truth.store, run.run)[self.iids]
            if not fresh.any():
                continue
            trajectory = self._truth.store.instances.trajectory[self.iids][fresh]
            of = {label: made[run.run][fresh] for label, made in errors.items()}
            for name in names:
                alone, without = of[f"only {name}"], of[f"no {name}"]
                scores.append(
                    FactorScore(
                        run.run, name, mean_interval(alone, trajectory),
                        mean_interval(without, trajectory),
                        float(np.median(alone)), float(np.median(without)),
                        mean_interval(alone - of["none"], trajectory),
                        mean_interval(of["all"] - without, trajectory),
                        int(fresh.sum()), int((~fresh).sum()),
                    )
                )  # fmt: skip
        return scores

    def errors(self, conditions: Mapping[str, Factors]) -> dict[str, Errors]:
        """Position errors (n,) in metres of `iids` by condition and run."""
        truth = self._truth
        parts: dict[str, list[Errors]] = {label: [] for label in conditions}
        for start in range(0, len(self.iids), _BATCH):
            iids = self.iids[start : start + _BATCH]
            rendered: dict[tuple[object, ...], RenderedViews] = {}
            for label, factors in conditions.items():
                side_view = side_camera(truth.data.recipe.frame, factors)
                scene = {k: v for k, v in factors.items() if FACTORS[k].shapes_scene}
                by_run: Errors = {}
                for move, evaluated in self._by_move.items():
                    camera = move_camera(side_view, move)
                    key = (camera, *sorted(scene.items()))
                    if key not in rendered:
                        rendered[key] = self._renderer(scene).render(truth.poses[iids], camera)
                    poses, numbers = truth.poses[iids], truth.numbers[iids]
                    by_run |= self._errors(evaluated, rendered[key], poses, factors, numbers)
                parts[label].append(by_run)
        return {label: _concatenate(found) for label, found in parts.items()}

    def _renderer(self, scene: Factors) -> SceneRenderer:
        key = tuple(sorted(scene.items()))
        if key not in self._renderers:
            self._renderers[key] = self._truth.data.world.renderer(scene)
        return self._renderers[key]

    def _errors(
        self, evaluated: EvaluatedRuns, views: RenderedViews, poses: NDArray[np.float64],
        factors: Factors, numbers: NDArray[np.intp],
    ) -> Errors:  # fmt: skip
        """Errors by run on rendered views after the factors' sensor effects."""
        sensed = apply_sensor_factors(views, factors, self._truth.data.recipe.seed, numbers)
        return {run.run: self._position_errors(run, b, sensed, poses) for run, b in evaluated}

    def _errors_of_all(
        self, renderer: SceneRenderer, rows: NDArray[np.intp], poses: NDArray[np.float64]
    ) -> Errors:
        """Errors by run on real views of some poses, each run through its own camera."""
        numbers, by_run = _SEED_OFFSET + rows, Errors()
        for move, evaluated in self._by_move.items():
            views = renderer.render(poses[rows], move_camera(self._truth.data.camera("real"), move))
            by_run |= self._errors(evaluated, views, poses[rows], self.active, numbers)
        return by_run

    def object_scores(self) -> list[ObjectScore]:
        """Scores of restoring each labelled object to its simulated state, with all else unchanged.

        Only for runs whose model was trained on none of the store's instances, because the views
        lie between them.
        """
        changes = {item["object"]: item for item in labelled_changes(self._truth.data.world)}
        store, names = self._truth.store, [run.run for run, _ in self._evaluated]
        fresh = [name for name in names if run_metrics.held_out(store, name).all()]
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
        parts = [
            self._errors_of_all(data.renderer("real"), rows, poses)
            for rows in np.split(used, range(_BATCH, len(used), _BATCH))
        ]
        before = _concatenate(parts)
        for number, rows in views.items():
            places = np.searchsorted(used, rows)
            restored = data.world.renderer(self.active, restored=number)
            after = self._errors_of_all(restored, rows, poses)
            yield number, {run: errors[places] for run, errors in before.items()}, after

    def _views_of_objects(self, poses: NDArray[np.float64]) -> dict[int, NDArray[np.intp]]:
        """Rows of `poses` whose views show each labelled object in either scene, evenly spread."""
        data = self._truth.data
        camera = side_camera(_SEARCH_FRAME, self.active)
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
                spread = np.linspace(0, rows.size - 1, min(rows.size, MAX_VIEWS)).astype(int)
                found[number] = rows[np.unique(spread)]
        return found

    def _position_errors(
        self, run: Run, backend: Backend, views: RenderedViews, poses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Position errors (n,) in metres on real views, after the run's adjustments."""
        domain = self._truth.store.domain(run.real_domain)
        depth = self._truth.data.raw_depth(views)
        valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
        rgb, depth = apply_chain(
            views.rgb, depth, valid, run.real_adjustments, self._truth.store.path
        )
        x = preprocess(rgb, depth, domain.depth_scale, backend.model.contract, valid)
        batches = np.split(x, range(backend.batch, len(x), backend.batch))
        predicted = [backend.forward_all(batch).pose for batch in batches]
        offset = np.concatenate(predicted)[:, :2] - poses[:, :2]
        return np.asarray(np.hypot(offset[:, 0], offset[:, 1]), dtype=np.float64)


def _concatenate(parts: list[Errors]) -> Errors:
    return {run: np.concatenate([part[run] for part in parts]) for run in parts[0]}


def _mean_of_views(values: NDArray[np.float64]) -> Interval:
    """Mean over views that are not neighbours; too few views have no interval."""
    if values.size < MIN_VIEWS:
        return Interval.unknown(float(values.mean()))
    return mean_interval(values, settings=BootstrapSettings(block_length=1))
