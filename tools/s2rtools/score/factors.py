"""Why the pose suffers: the error with each factor alone, without each, and per changed object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from s2rstore import stats
from s2rstore.records import Run
from s2rtools.adjust import apply_chain
from s2rtools.inference import Backend, open_backend
from s2rtools.models.contract import LoadedModel
from s2rtools.models.preprocess import preprocess
from s2rtools.score.truth import Truth
from s2rtools.world.factors import FACTORS
from s2rtools.world.renderer import Renderer, Views
from s2rtools.world.world import DEPTH_SCALE, facts, side_camera, through_sensor

MIN_SHARE = 0.004
"""Of a view's pixels, for an object to count as seen."""
MIN_VIEWS = 5
MAX_FRAMES = 40
"""Per object, spread over those that see it."""


@dataclass(frozen=True, slots=True)
class FactorScore:
    """Real error in metres with one factor alone and with all but it, over `n` instances.

    `cost` is what the factor alone adds to the error without any; `gain` what leaving it out takes
    from the error with all.
    """

    run: str
    factor: str
    alone: stats.Interval
    without: stats.Interval
    alone_median: float
    without_median: float
    cost: stats.Interval
    gain: stats.Interval
    n: int


@dataclass(frozen=True, slots=True)
class ObjectScore:
    """What restoring one changed object takes from the real error where it is seen, metres."""

    run: str
    object: int
    name: str
    change: str
    gain: stats.Interval
    n: int


class Counterfactuals:
    """Errors of models on views of the world under other factors; renderings are shared."""

    def __init__(self, truth: Truth, instances: int) -> None:
        self._truth = truth
        n = len(truth.poses)
        self.iids = np.unique(np.linspace(0, n - 1, min(n, instances)).astype(int))
        self.active = {k: v for k, v in truth.data.severities("real").items() if v > 0}
        self._rendered: dict[tuple[object, ...], Views] = {}
        self._backends: dict[str, Backend] = {}
        self._renderers: dict[tuple[object, ...], Renderer] = {}

    def factor_scores(self, run: Run, model: LoadedModel) -> list[FactorScore]:
        none, everything = self.errors(run, model, {}), self.errors(run, model, self.active)
        found = []
        for name in [name for name in FACTORS if name in self.active]:
            alone = self.errors(run, model, {name: self.active[name]})
            rest = {k: v for k, v in self.active.items() if k != name}
            without = self.errors(run, model, rest)
            found.append(
                FactorScore(
                    run.run, name, stats.bootstrap_mean(alone), stats.bootstrap_mean(without),
                    float(np.median(alone)), float(np.median(without)),
                    stats.bootstrap_mean(alone - none), stats.bootstrap_mean(everything - without),
                    len(alone),
                )
            )  # fmt: skip
        return found

    def errors(
        self, run: Run, model: LoadedModel, factors: Mapping[str, float]
    ) -> NDArray[np.float64]:
        """Position errors (n,) in metres of `iids`, through the run's real adjustments."""
        rendered = self._views(factors)
        numbers = self._truth.numbers[self.iids]
        views = through_sensor(rendered, factors, self._truth.data.recipe.seed, numbers)
        return self._judge(run, model, views, self.iids)

    def _views(self, factors: Mapping[str, float]) -> Views:
        frame = self._truth.data.recipe.frame
        camera = side_camera(frame, factors)
        scene = {k: v for k, v in factors.items() if FACTORS[k].shapes_scene}
        key = (*sorted(scene.items()), camera)
        if key not in self._rendered:
            poses = self._truth.poses[self.iids]
            self._rendered[key] = self._renderer(scene).render(poses, camera)
        return self._rendered[key]

    def _renderer(self, scene: Mapping[str, float]) -> Renderer:
        key = tuple(sorted(scene.items()))
        if key not in self._renderers:
            self._renderers[key] = self._truth.data.world.renderer(scene)
        return self._renderers[key]

    def object_scores(self, run: Run, model: LoadedModel) -> list[ObjectScore]:
        """Each labelled object put back as it is in simulation, the rest of the gap kept."""
        known = {fact["object"]: fact for fact in facts(self._truth.data.world)}
        found = []
        for number, (iids, restored) in self._restored.items():
            before = self._judge(run, model, self._stored(run, iids), iids)
            gain = before - self._judge(run, model, restored, iids)
            found.append(
                ObjectScore(run.run, number, known[number]["name"], known[number]["change"],
                            _spread(gain), len(iids))
            )  # fmt: skip
        return found

    @cached_property
    def _restored(self) -> dict[int, tuple[NDArray[np.intp], Views]]:
        """Per object the instances that see it, and their real views with it put back."""
        truth, found = self._truth, {}
        data, seen = truth.data, truth.seen["real"]
        camera = side_camera(data.recipe.frame, self.active)
        for number in truth.changed:
            share = ((seen.sim == number) | (seen.real == number)).mean(axis=(1, 2))
            iids = np.flatnonzero(share >= MIN_SHARE)
            if not iids.size:
                continue
            spread = np.linspace(0, iids.size - 1, min(iids.size, MAX_FRAMES)).astype(int)
            iids = iids[np.unique(spread)]
            renderer = data.world.renderer(self.active, restored=number)
            views = renderer.render(truth.poses[iids], camera)
            found[number] = (
                iids,
                through_sensor(views, self.active, data.recipe.seed, truth.numbers[iids]),
            )
        return found

    def _stored(self, run: Run, iids: NDArray[np.intp]) -> Views:
        """The real views that the store holds."""
        shots = [self._truth.store.frame(int(iid), run.real_domain) for iid in iids]
        depth = np.stack([shot.depth.astype(np.float32) for shot in shots]) * np.float32(
            DEPTH_SCALE
        )
        return Views(np.stack([shot.rgb for shot in shots]), depth, np.zeros(depth.shape, np.int16))

    def _judge(
        self, run: Run, model: LoadedModel, views: Views, iids: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Position errors (n,) in metres on real views, through the run's adjustments."""
        truth = self._truth
        domain = truth.store.domains[run.real_domain]
        depth = truth.data.raw(views)
        valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
        rgb, depth = apply_chain(views.rgb, depth, valid, run.real_adjustments)
        x = preprocess(rgb, depth, domain.depth_scale, model.network.input_size)
        backend = self._backend(model)
        poses = [
            backend.forward_all(x[start : start + backend.batch]).pose
            for start in range(0, len(x), backend.batch)
        ]
        away = np.concatenate(poses)[:, :2] - truth.poses[iids, :2]
        return np.asarray(np.hypot(away[:, 0], away[:, 1]), dtype=np.float64)

    def _backend(self, model: LoadedModel) -> Backend:
        if model.sha256 not in self._backends:
            self._backends = {model.sha256: open_backend(model, "torch", 0)}
        return self._backends[model.sha256]


def _spread(values: NDArray[np.float64]) -> stats.Interval:
    """The mean of views that are no neighbours; too few of them have no interval."""
    if values.size < MIN_VIEWS:
        return stats.Interval(float(values.mean()), float("nan"), float("nan"))
    return stats.bootstrap_mean(values, stats.Bootstrap(block_length=1))
