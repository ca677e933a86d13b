"""Why the pose suffers: the error with each factor alone, without each, and per changed object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import CameraMove
from s2rstore.metrics import run_metrics
from s2rstore.metrics.bootstrap import BootstrapSettings, Interval, mean_interval
from s2rstore.records import Run
from s2rtools.adjustments import apply_chain
from s2rtools.inference import Backend
from s2rtools.models.preprocessing import preprocess
from s2rtools.scoring.ground_truth import Truth, moved
from s2rtools.synthetic_world.factors import FACTORS
from s2rtools.synthetic_world.renderer import Renderer, Views
from s2rtools.synthetic_world.world import facts, side_camera, through_sensor

DENSE = 240
"""Poses along each route, among which views of an object are looked for."""
MIN_SHARE = 0.004
"""Of a view's pixels, for an object to count as seen."""
MIN_VIEWS = 5
MAX_VIEWS = 12
_LOOK = 32
_BATCH = 32
_APART = 100_000_000

Factors = Mapping[str, float]
Judges = Sequence[tuple[Run, Backend]]
Errors = dict[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class FactorScore:
    """Real error in metres with one factor alone and with all but it, over `n` instances.

    `cost` is what the factor alone adds to the error without any; `gain` what leaving it out takes
    from the error with all. `left_out` instances were trained on.
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
    """What restoring one changed object takes from the real error where it is seen, metres.

    Over at most `MAX_VIEWS` views of it along the routes; fewer than `MIN_VIEWS` have no interval.
    """

    run: str
    object: int
    name: str
    change: str
    gain: Interval
    n: int


class Counterfactuals:
    """Errors of models on views of the world as it is not; a rendering serves all of them."""

    def __init__(self, truth: Truth, judges: Judges, instances: int) -> None:
        self._truth, self._judges = truth, judges
        n = len(truth.poses)
        self.iids = np.unique(np.linspace(0, n - 1, min(n, instances)).astype(int))
        self.active = {k: v for k, v in truth.data.severities("real").items() if v > 0}
        self._renderers: dict[tuple[object, ...], Renderer] = {}
        self._by_move: dict[CameraMove, list[tuple[Run, Backend]]] = {}
        for run, backend in judges:
            self._by_move.setdefault(truth.moves(run.run)["real"], []).append((run, backend))

    def factor_scores(self) -> list[FactorScore]:
        """Each active factor for each run that has instances it was not trained on."""
        names = [n for n, found in FACTORS.items() if n in self.active and not found.moves_robot]
        conditions: dict[str, Factors] = {"none": {}, "all": self.active}
        for name in names:
            conditions[f"only {name}"] = {name: self.active[name]}
            conditions[f"no {name}"] = {k: v for k, v in self.active.items() if k != name}
        errors = self.errors(conditions)
        found = []
        for run, _ in self._judges:
            fresh = run_metrics.held_out(self._truth.store, run.run)[self.iids]
            if not fresh.any():
                continue
            trajectory = self._truth.store.instances.trajectory[self.iids][fresh]
            of = {label: made[run.run][fresh] for label, made in errors.items()}
            for name in names:
                alone, without = of[f"only {name}"], of[f"no {name}"]
                found.append(
                    FactorScore(
                        run.run, name, mean_interval(alone, trajectory),
                        mean_interval(without, trajectory),
                        float(np.median(alone)), float(np.median(without)),
                        mean_interval(alone - of["none"], trajectory),
                        mean_interval(of["all"] - without, trajectory),
                        int(fresh.sum()), int((~fresh).sum()),
                    )
                )  # fmt: skip
        return found

    def errors(self, conditions: Mapping[str, Factors]) -> dict[str, Errors]:
        """Position errors (n,) in metres of `iids` by condition and run."""
        truth = self._truth
        parts: dict[str, list[Errors]] = {label: [] for label in conditions}
        for start in range(0, len(self.iids), _BATCH):
            iids = self.iids[start : start + _BATCH]
            rendered: dict[tuple[object, ...], Views] = {}
            for label, factors in conditions.items():
                own = side_camera(truth.data.recipe.frame, factors)
                scene = {k: v for k, v in factors.items() if FACTORS[k].shapes_scene}
                found: Errors = {}
                for move, judges in self._by_move.items():
                    camera = moved(own, move)
                    key = (camera, *sorted(scene.items()))
                    if key not in rendered:
                        rendered[key] = self._renderer(scene).render(truth.poses[iids], camera)
                    poses, numbers = truth.poses[iids], truth.numbers[iids]
                    found |= self._errors(judges, rendered[key], poses, factors, numbers)
                parts[label].append(found)
        return {label: _joined(found) for label, found in parts.items()}

    def _renderer(self, scene: Factors) -> Renderer:
        key = tuple(sorted(scene.items()))
        if key not in self._renderers:
            self._renderers[key] = self._truth.data.world.renderer(scene)
        return self._renderers[key]

    def _errors(
        self,
        judges: Judges,
        views: Views,
        poses: NDArray[np.float64],
        factors: Factors,
        numbers: NDArray[np.intp],
    ) -> Errors:
        """Errors by run of rendered views, once the factors' sensors have had their part."""
        made = through_sensor(views, factors, self._truth.data.recipe.seed, numbers)
        return {run.run: self._judged(run, backend, made, poses) for run, backend in judges}

    def _seen_by_all(
        self, renderer: Renderer, rows: NDArray[np.intp], poses: NDArray[np.float64]
    ) -> Errors:
        """Errors by run of real views of some poses, each run's through its own camera."""
        numbers, found = _APART + rows, Errors()
        for move, judges in self._by_move.items():
            views = renderer.render(poses[rows], moved(self._truth.data.camera("real"), move))
            found |= self._errors(judges, views, poses[rows], self.active, numbers)
        return found

    def object_scores(self) -> list[ObjectScore]:
        """Each labelled object put back as it is in simulation, the rest of the gap kept.

        For runs whose model was trained on none of the store's instances: the views lie between
        them.
        """
        known = {fact["object"]: fact for fact in facts(self._truth.data.world)}
        fresh = {
            run.run: run_metrics.held_out(self._truth.store, run.run).all()
            for run, _ in self._judges
        }
        found = []
        for number, before, after in self._restored():
            for run, _ in self._judges:
                gain = before[run.run] - after[run.run]
                if fresh[run.run]:
                    found.append(
                        ObjectScore(run.run, number, known[number]["name"],
                                    known[number]["change"], _spread(gain), gain.size)
                    )  # fmt: skip
        order = {run.run: place for place, (run, _) in enumerate(self._judges)}
        return sorted(found, key=lambda row: (order[row.run], row.object))

    def _restored(self) -> Iterator[tuple[int, Errors, Errors]]:
        """Per object that is seen at all: errors on the same views without and with it put back."""
        data = self._truth.data
        poses = np.concatenate([data.world.poses(name, DENSE) for name in data.names])
        views = self._views_of_objects(poses)
        if not views:
            return
        used = np.unique(np.concatenate(list(views.values())))
        parts = [
            self._seen_by_all(data.renderer("real"), rows, poses)
            for rows in np.split(used, range(_BATCH, len(used), _BATCH))
        ]
        before = _joined(parts)
        for number, rows in views.items():
            places = np.searchsorted(used, rows)
            restored = data.world.renderer(self.active, restored=number)
            after = self._seen_by_all(restored, rows, poses)
            yield number, {run: errors[places] for run, errors in before.items()}, after

    def _views_of_objects(self, poses: NDArray[np.float64]) -> dict[int, NDArray[np.intp]]:
        """Rows of `poses` that see each labelled object, in either scene, spread over them."""
        data = self._truth.data
        camera = side_camera(_LOOK, self.active)
        shares = np.zeros((len(self._truth.changed), len(poses)))
        for start in range(0, len(poses), 256):
            span = slice(start, start + 256)
            ids = [data.renderer(scene).render(poses[span], camera, samples=0).identity
                   for scene in ("sim", "real")]  # fmt: skip
            for place, number in enumerate(self._truth.changed):
                seen = (ids[0] == number) | (ids[1] == number)
                shares[place, span] = seen.mean(axis=(1, 2))
        found = {}
        for number, share in zip(self._truth.changed, shares, strict=True):
            rows = np.flatnonzero(share >= MIN_SHARE)
            if rows.size:
                spread = np.linspace(0, rows.size - 1, min(rows.size, MAX_VIEWS)).astype(int)
                found[number] = rows[np.unique(spread)]
        return found

    def _judged(
        self, run: Run, backend: Backend, views: Views, poses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Position errors (n,) in metres on real views, through the run's adjustments."""
        domain = self._truth.store.domain(run.real_domain)
        depth = self._truth.data.raw(views)
        valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
        rgb, depth = apply_chain(views.rgb, depth, valid, run.real_adjustments)
        x = preprocess(rgb, depth, domain.depth_scale, backend.model.network.input_size)
        found = [
            backend.forward_all(x[start : start + backend.batch]).pose
            for start in range(0, len(x), backend.batch)
        ]
        away = np.concatenate(found)[:, :2] - poses[:, :2]
        return np.asarray(np.hypot(away[:, 0], away[:, 1]), dtype=np.float64)


def _joined(parts: list[Errors]) -> Errors:
    return {run: np.concatenate([part[run] for part in parts]) for run in parts[0]}


def _spread(values: NDArray[np.float64]) -> Interval:
    """The mean of views that are no neighbours; too few of them have no interval."""
    if values.size < MIN_VIEWS:
        return Interval.unknown(float(values.mean()))
    return mean_interval(values, settings=BootstrapSettings(block_length=1))
