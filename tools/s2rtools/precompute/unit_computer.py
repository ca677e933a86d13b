"""Compute any work unit of a store within one process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.arrays import array_writer, stored_array
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.files import layout
from s2rtools.inference import Backend
from s2rtools.models.load_model import load_model
from s2rtools.precompute import unit_results
from s2rtools.precompute.frame_reader import Renderers, RunFrames
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.tasks import (
    image_heatmaps,
    map_grids,
    network_outputs,
    outliers,
    rendered_frames,
    umap_projection,
)
from s2rtools.precompute.work_units import ArraySpec, WorkUnit


class UnitComputer:
    """Computes work units of one store; models are loaded once per process."""

    def __init__(self, backends: RunBackends | None, trust: bool, root: Path, threads: int) -> None:
        """`backends` are those that the arrays' keys contain; None where no unit runs a network."""
        self._root, self._threads = root, threads
        self._store = s2rstore.open(root)
        self._run_backends, self._trust = backends, trust
        self._backends: dict[str, tuple[Backend, Backend]] = {}
        self._renderers: Renderers = {}
        self._layouts: dict[str, Layout] = {}

    def __call__(self, unit: WorkUnit) -> None:
        """Compute the missing arrays of a unit and write them as its result."""
        chunks = encoded(unit, self._compute(unit), self._layout)
        unit_results.write(self._root, unit, chunks)

    def _layout(self, path: str) -> Layout:
        if path not in self._layouts:
            array = stored_array.open_read(self._root / layout.RUNS / path, self._root)
            self._layouts[path] = array.layout
        return self._layouts[path]

    def _compute(self, unit: WorkUnit) -> dict[ArraySpec, Any]:
        run = self._store.run(unit.stage.run)
        if unit.stage.name == "projection":
            return umap_projection.compute_projection(self._root, unit)
        if unit.stage.name == "outlier":
            return dict(outliers.compute_distances(self._root, unit, self._threads))
        if unit.stage.name == map_grids.STAGE:
            return dict(
                map_grids.compute_grids(self._store, run, unit.stage, unit.instances, unit.missing)
            )
        if unit.stage.name == "frames":
            frames = RunFrames(self._store, run, renderers=self._renderers)
            return rendered_frames.render_frames(frames, unit)
        if unit.stage.name == image_heatmaps.STAGE:
            return dict(image_heatmaps.compute_heatmaps(self._store, run, unit))
        name = run.network(unit.stage.name)
        if name not in self._backends:
            assert self._run_backends is not None
            model = load_model(self._store, name, self._trust)
            self._backends = {name: self._run_backends.open(model, self._threads)}
        return network_outputs.compute_outputs(self._store, run, *self._backends[name], unit)


def encoded(
    unit: WorkUnit, values: Mapping[ArraySpec, Any], layout_of: Callable[[str], Layout]
) -> dict[str, list[bytes]]:
    """The compressed chunks of a unit's arrays, by their paths in runs.zarr."""
    chunks = {}
    for spec, rows in values.items():
        path = spec.path(unit.stage.run)
        if unit.stage.is_aggregate:
            chunks[path] = unit_results.encode_totals(rows)
        else:
            chunks[path] = array_writer.encode_chunks(layout_of(path), rows)
    return chunks
