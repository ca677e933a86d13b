"""What one process needs to compute any work unit of a store."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rstore.run_inputs import FRAME_KINDS
from s2rtools.heatmaps import HEATMAP_KINDS, PairBatch, SideBatch
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.inference import Backend, open_backend
from s2rtools.models.library import load_model
from s2rtools.precompute import rig_calibration
from s2rtools.precompute.frame_reader import (
    PairFrames,
    Renderers,
    RunFrames,
    SideFrames,
    read_pairs,
)
from s2rtools.precompute.tasks import map_grids, outliers, umap_projection
from s2rtools.precompute.work_units import ArraySpec, WorkUnit

Values = dict[ArraySpec, NDArray[Any]]


class Computer:
    """Computes units of one store; models are loaded once per process."""

    def __init__(self, root: Path, backends: dict[str, str], trust: bool, threads: int) -> None:
        """`backends` names for each run the backend that its keys were made with."""
        self._root = root
        self._store = s2rstore.open(root)
        self._backend_names = backends
        self._trust = trust
        self._threads = threads
        self._backends: dict[str, Backend] = {}
        self._renderers: Renderers = {}

    def __call__(self, unit: WorkUnit) -> None:
        """Compute and write what is missing of one shard."""
        run = self._store.run(unit.stage.run)
        unit.stage.write(self._root, unit.shard, self._compute(run, unit))

    def _compute(self, run: Run, unit: WorkUnit) -> Values:
        if unit.stage.name == "projection":
            return _projection(self._root, unit)
        if unit.stage.name == "outlier":
            return dict(outliers.distances(self._root, unit, self._threads))
        if unit.stage.name.startswith("map:"):
            return map_grids.grids(self._store, run, unit)
        if unit.stage.name == "frames":
            return self._rendered(run, unit)
        return self._network(run, unit)

    def _rendered(self, run: Run, unit: WorkUnit) -> Values:
        frames = RunFrames(self._store, run, renderers=self._renderers)
        found: Values = {}
        for side in SIDES:
            wanted = [spec for spec in unit.missing if spec.side == side]
            images = frames.read(side, *unit.stage.span(unit.shard)) if wanted else {}
            by_kind = {FRAME_KINDS[image]: values for image, values in images.items()}
            found |= {spec: by_kind[spec.kind] for spec in wanted}
        return found

    def backend(self, run: Run) -> Backend:
        if run.run not in self._backends:
            model = load_model(self._store, run.model, self._trust)
            name = self._backend_names[run.run]
            self._backends = {run.run: open_backend(model, name, self._threads)}
        return self._backends[run.run]

    def _network(self, run: Run, unit: WorkUnit) -> Values:
        backend = self.backend(run)
        start, stop = unit.stage.span(unit.shard)
        parts: dict[ArraySpec, list[NDArray[Any]]] = {spec: [] for spec in unit.missing}
        size = backend.model.network.input_size
        aligned = rig_calibration.load_alignment(self._store, run)
        source = RunFrames(self._store, run, unit.stage.kept(self._root))
        for iid, frames in read_pairs(self._store, run, size, start, stop, backend.batch, source):
            pair = pair_batch(self._store, backend, iid, frames, aligned)
            for spec, values in _pair_values(pair, unit.missing).items():
                parts[spec].append(values)
        return {spec: np.concatenate(found) for spec, found in parts.items()}


def opener(backends: dict[str, str], trust: bool) -> Callable[[Path, int], Computer]:
    """The function that `workers.run_units` calls once in each process."""
    return partial(_open, backends, trust)


def _open(backends: dict[str, str], trust: bool, root: Path, threads: int) -> Computer:
    return Computer(root, backends, trust, threads)


def pair_batch(
    store: Store,
    backend: Backend,
    iid: int,
    frames: PairFrames,
    aligned: ImageAlignment | None = None,
) -> PairBatch:
    """Both sides of a batch after the forward pass; the first instance is `iid`."""
    rows = slice(iid, iid + len(frames["sim"].x))
    truth = store.instances
    poses = np.stack([truth.x[rows], truth.y[rows], truth.heading[rows]], axis=1)
    sim, real = (side_batch(backend, frames[side], poses) for side in SIDES)
    return PairBatch(backend.model, backend, sim, real, aligned)


def side_batch(backend: Backend, frames: SideFrames, poses: NDArray[np.float64]) -> SideBatch:
    """One side after the forward pass; `poses` (B, 3) are the truth."""
    forward = backend.forward_all(frames.x)
    return SideBatch(
        x=forward.x,
        rgb=frames.rgb,
        depth=frames.depth,
        valid=frames.valid,
        depth_scale=frames.depth_scale,
        features=forward.features,
        embedding=forward.embedding,
        prediction=forward.pose,
        truth=poses,
    )


def _pair_values(pair: PairBatch, specs: tuple[ArraySpec, ...]) -> Values:
    values: Values = {}
    computed: dict[str, Any] = {}
    for spec in specs:
        if spec.kind == "prediction":
            values[spec] = np.asarray(pair.side(spec.side).prediction, dtype=np.float64)
        elif spec.kind == "embedding":
            values[spec] = as_stored(np.asarray(pair.side(spec.side).embedding), spec.dtype)
        else:
            if spec.kind not in computed:
                computed[spec.kind] = HEATMAP_KINDS[spec.kind].compute(pair)
            values[spec] = as_stored(computed[spec.kind][spec.side, spec.mode], spec.dtype)
    return values


def as_stored(values: NDArray[Any], dtype: str) -> NDArray[Any]:
    """Values in their array's type: what float16 cannot hold becomes its largest, NaN stays."""
    if dtype != "float16":
        return values.astype(dtype)
    limit = np.finfo(np.float16).max
    return np.clip(values, -limit, limit).astype(np.float16)


def _projection(root: Path, unit: WorkUnit) -> Values:
    stage = unit.stage
    valid = stage.valid(root)
    embeddings = tuple(stage.source(root, "embedding", side) for side in SIDES)
    sim, real, _ = umap_projection.principal_components((embeddings[0], embeddings[1]), valid)
    plane = umap_projection.joint_umap((sim, real), valid)
    made = {("pca", "sim"): sim, ("pca", "real"): real}
    made |= {("umap", "sim"): plane[0], ("umap", "real"): plane[1]}
    return {spec: made[spec.kind, str(spec.side)] for spec in unit.missing}
