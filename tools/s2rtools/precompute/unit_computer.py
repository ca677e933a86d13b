"""Compute any work unit of a store within one process."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.records import Run
from s2rtools.inference import Backend, open_backend
from s2rtools.models.library import load_model
from s2rtools.precompute import rig_calibration
from s2rtools.precompute.frame_reader import Renderers, RunFrames, read_pairs
from s2rtools.precompute.tasks import (
    map_grids,
    network_outputs,
    outliers,
    rendered_frames,
    umap_projection,
)
from s2rtools.precompute.work_units import ArraySpec, WorkUnit


class UnitComputer:
    """Computes work units of one store; models are loaded once per process."""

    def __init__(self, root: Path, backends: dict[str, str], trust: bool, threads: int) -> None:
        """`backends` maps each run to the name of the backend that its keys contain."""
        self._root = root
        self._store = s2rstore.open(root)
        self._backend_names = backends
        self._trust = trust
        self._threads = threads
        self._backends: dict[str, Backend] = {}
        self._renderers: Renderers = {}

    def __call__(self, unit: WorkUnit) -> None:
        """Compute and write the missing arrays of one shard."""
        run = self._store.run(unit.stage.run)
        unit.stage.write(self._root, unit.shard, self._compute(run, unit))

    def _compute(self, run: Run, unit: WorkUnit) -> dict[ArraySpec, Any]:
        if unit.stage.name == "projection":
            return umap_projection.compute_projection(self._root, unit)
        if unit.stage.name == "outlier":
            return dict(outliers.compute_distances(self._root, unit, self._threads))
        if unit.stage.name.startswith("map:"):
            return map_grids.compute_grids(self._store, run, unit)
        if unit.stage.name == "frames":
            frames = RunFrames(self._store, run, renderers=self._renderers)
            return rendered_frames.render_frames(frames, unit)
        return self._compute_network_outputs(run, unit)

    def backend(self, run: Run) -> Backend:
        if run.run not in self._backends:
            model = load_model(self._store, run.model, self._trust)
            name = self._backend_names[run.run]
            self._backends = {run.run: open_backend(model, name, self._threads)}
        return self._backends[run.run]

    def _compute_network_outputs(self, run: Run, unit: WorkUnit) -> dict[ArraySpec, Any]:
        backend = self.backend(run)
        start, stop = unit.stage.row_range(unit.shard)
        batches: dict[ArraySpec, list[NDArray[Any]]] = {spec: [] for spec in unit.missing}
        size = backend.model.network.input_size
        alignment = rig_calibration.load_alignment(self._store, run)
        source = RunFrames(self._store, run, unit.stage.rendered_arrays(self._root))
        for iid, frames in read_pairs(self._store, run, size, start, stop, backend.batch, source):
            pair = network_outputs.pair_batch(self._store, backend, iid, frames, alignment)
            for spec, values in network_outputs.pair_values(pair, unit.missing).items():
                batches[spec].append(values)
        return {spec: np.concatenate(parts) for spec, parts in batches.items()}


def worker_factory(backends: dict[str, str], trust: bool) -> Callable[[Path, int], UnitComputer]:
    """The function that `executors.run_units` calls once in each process."""
    return partial(_open_computer, backends, trust)


def _open_computer(
    backends: dict[str, str], trust: bool, root: Path, threads: int
) -> UnitComputer:  # fmt: skip
    return UnitComputer(root, backends, trust, threads)
