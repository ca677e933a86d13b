"""Position errors of runs on counterfactual real views: other factors, or restored objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.inference import Backend, open_backend
from s2rtools.models.load_model import load_model
from s2rtools.precompute.frame_reader import SourceBlock, side_frames
from s2rtools.scoring.ground_truth import GroundTruth, move_camera
from s2rtools.synthetic_world.factors import scene_severities
from s2rtools.synthetic_world.renderer import Camera, RenderedViews, SceneRenderer

BATCH = 32
"""Views that are rendered at once."""

Factors = Mapping[str, float]
EvaluatedRuns = Sequence[tuple[Run, Backend]]
Errors = dict[str, NDArray[np.float64]]
"""Position errors (n,) in metres by run."""


def open_runs(store: Store, runs: Iterable[str], trust: bool = False) -> EvaluatedRuns:
    """Runs with their networks in float32 torch; `trust` allows formats that execute code."""
    records = [store.run(run) for run in runs]
    return [
        (run, open_backend(load_model(store, run.network("scoring"), trust), "torch"))
        for run in records
    ]


class CounterfactualErrors:
    """Errors of runs on counterfactual real views of the world; all runs share each rendering.

    `active` are the severities of the store's real side.
    """

    def __init__(self, truth: GroundTruth, evaluated: EvaluatedRuns) -> None:
        self.truth, self.evaluated = truth, evaluated
        self.active = {k: v for k, v in truth.data.severities("real").items() if v > 0}
        self._renderers: dict[tuple[object, ...], SceneRenderer] = {}
        self._by_move: dict[RenderChange, list[tuple[Run, Backend]]] = {}
        for run, backend in evaluated:
            self._by_move.setdefault(truth.camera_moves(run.run)["real"], []).append((run, backend))

    @property
    def runs(self) -> list[str]:
        return [run.run for run, _ in self.evaluated]

    def of_instances(
        self, iids: NDArray[np.intp], conditions: Mapping[str, Factors]
    ) -> dict[str, Errors]:
        """Errors on the instances' real views with the factors of each condition, by condition.

        Each view keeps its own sensor noise in all conditions.
        """
        truth = self.truth
        parts: dict[str, list[Errors]] = {label: [] for label in conditions}
        for start in range(0, len(iids), BATCH):
            rows = iids[start : start + BATCH]
            poses, numbers = truth.poses[rows], truth.numbers[rows]
            rendered: dict[tuple[object, ...], RenderedViews] = {}
            for label, factors in conditions.items():
                side_view = truth.data.camera_with(factors)
                scene = scene_severities(factors)
                by_run: Errors = {}
                for move, evaluated in self._by_move.items():
                    camera = move_camera(side_view, move)
                    key = (camera, *sorted(scene.items()))
                    if key not in rendered:
                        rendered[key] = self._renderer(scene).render(poses, camera)
                    by_run |= self._sensed(evaluated, rendered[key], poses, factors, numbers)
                parts[label].append(by_run)
        return {label: self._joined(found) for label, found in parts.items()}

    def of_views(
        self, renderer: SceneRenderer, poses: NDArray[np.float64], numbers: NDArray[np.intp]
    ) -> Errors:
        """Errors on the real views of poses (n, 3) in the scene of `renderer`.

        `numbers` (n,) seed the sensor noise of each view.
        """
        parts = []
        for start in range(0, len(poses), BATCH):
            rows, by_run = slice(start, start + BATCH), Errors()
            for move, evaluated in self._by_move.items():
                views = renderer.render(poses[rows], self.real_camera(move))
                by_run |= self._sensed(evaluated, views, poses[rows], self.active, numbers[rows])
            parts.append(by_run)
        return self._joined(parts)

    def _joined(self, parts: list[Errors]) -> Errors:
        return {
            run: np.concatenate([np.zeros(0), *(part[run] for part in parts)]) for run in self.runs
        }

    def real_camera(self, move: RenderChange) -> Camera:
        """The true real camera, moved by a run's adjustment."""
        return move_camera(self.truth.data.camera("real"), move)

    def _renderer(self, scene: Factors) -> SceneRenderer:
        key = tuple(sorted(scene.items()))
        if key not in self._renderers:
            self._renderers[key] = self.truth.data.world.renderer(scene)
        return self._renderers[key]

    def _sensed(
        self, evaluated: EvaluatedRuns, views: RenderedViews, poses: NDArray[np.float64],
        factors: Factors, numbers: NDArray[np.intp],
    ) -> Errors:  # fmt: skip
        """Errors by run on rendered views after the factors' sensor effects."""
        sensed = self.truth.data.sensed(views, factors, numbers)
        return {run.run: self._position_errors(run, b, sensed, poses) for run, b in evaluated}

    def _position_errors(
        self, run: Run, backend: Backend, views: RenderedViews, poses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Position errors (n,) in metres on real views, after the run's adjustments."""
        domain = self.truth.store.domain(run.real_domain)
        images: SourceBlock = {"rgb": views.rgb, "depth": self.truth.data.raw_depth(views)}
        contract, path = backend.model.contract, self.truth.store.path
        x = side_frames(images, domain, run.real_adjustments, contract, path).x
        batches = np.split(x, range(backend.batch, len(x), backend.batch))
        predicted = [backend.forward_all(batch).pose for batch in batches]
        offset = np.concatenate(predicted)[:, :2] - poses[:, :2]
        return np.asarray(np.hypot(offset[:, 0], offset[:, 1]), dtype=np.float64)
