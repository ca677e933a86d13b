"""Compute any work unit of a store within one process."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import torch
from threadpoolctl import threadpool_limits

import s2rstore
from s2rstore.arrays import array_writer, stored_array
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rstore.files.process_identity import host_name
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.common.freed_memory import keep_freed_memory
from s2rtools.inference import Backend
from s2rtools.inference.backend import processor_name
from s2rtools.models.load_model import load_model
from s2rtools.precompute import unit_results
from s2rtools.precompute.frame_reader import Renderers
from s2rtools.precompute.run_backends import BackendIdentity, RunBackends
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import FORWARD, NUMPY, ArraySpec, Stage, WorkUnit

_NUMERIC = (
    "torch", "openvino", "numpy", "opencv-python-headless", "scipy", "scikit-learn", "umap-learn",
    "numba",
)  # fmt: skip
"""Packages on whose version values depend."""


@dataclass(frozen=True, slots=True)
class Machine:
    """Models of the processor and of the GPU (empty without one), and versions of libraries."""

    processor: str
    gpu: str
    versions: tuple[tuple[str, str], ...]

    def environment(
        self, precision: str, threads: int, uses_gpu: bool = False
    ) -> ComputeEnvironment:
        device = self.gpu if uses_gpu else self.processor
        return ComputeEnvironment(device, precision, threads, dict(self.versions))


@cache
def this_machine() -> Machine:
    """The machine that this process runs on."""
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else ""
    return Machine(processor_name(), gpu, tuple(numeric_versions().items()))


def numeric_versions() -> dict[str, str]:
    """The versions of the installed packages on which values depend."""
    versions = {}
    for name in _NUMERIC:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


GENERATION_SECONDS = 90.0
"""How long a host waits to see a published generation; NFS caches files for up to 60 s."""


@dataclass(frozen=True, slots=True)
class Computation:
    """What computes units of a store: the backends of a run, and the store as it is published.

    `backends` are those that the arrays' keys contain; None where no unit runs a network. Results
    of a process of another host are `durable`. `identity` is that of the store, by which such a
    process recognises it.
    """

    root: Path
    generation: int
    backends: RunBackends | None = None
    trust: bool = False
    durable: bool = False
    identity: str = ""

    def open(self, threads: int) -> UnitComputer:
        """Make this process compute units with some threads.

        Raises RequestError where this host has no such store.
        """
        return UnitComputer(self, threads)

    def precision(self, stage: Stage) -> str:
        """In which precision a stage is computed."""
        if self.backends is None or not stage.is_network:
            return NUMPY
        return " + ".join(dict.fromkeys(each.precision for each in self._identities(stage)))

    def uses_gpu(self, stage: Stage) -> bool:
        if self.backends is None or not stage.is_network:
            return False
        return any(each.uses_gpu for each in self._identities(stage))

    def _identities(self, stage: Stage) -> list[BackendIdentity]:
        """The backends that run the network for a stage."""
        assert self.backends is not None
        heatmaps = self.backends.heatmaps
        return [self.backends.predictions, heatmaps] if stage.name == FORWARD else [heatmaps]

    def environment(self, stage: Stage, machine: Machine, threads: int) -> ComputeEnvironment:
        """In which environment a machine computes a stage."""
        return machine.environment(self.precision(stage), threads, self.uses_gpu(stage))


class UnitComputer:
    """Computes work units of one store, and keeps open what they share.

    These are the `store`, the `renderers` by domain, and the networks of one model.
    """

    def __init__(self, computation: Computation, threads: int) -> None:
        self._computation, self.threads = computation, threads
        self.root = computation.root
        self.store = open_generation(computation.root, computation.generation)
        self.renderers: Renderers = {}
        self._backends: dict[str, tuple[Backend, Backend]] = {}
        self._layouts: dict[str, Layout] = {}
        torch.set_num_threads(threads)
        threadpool_limits(threads)
        keep_freed_memory()

    def __call__(self, unit: WorkUnit) -> Receipt:
        """Compute the missing arrays of a unit and write them under a unique name."""
        began = time.perf_counter()
        assert unit.stage.compute is not None
        chunks = encoded(unit, unit.stage.compute(self, unit), self._layout)
        environment = self._computation.environment(unit.stage, this_machine(), self.threads)
        path, size, checksum = unit_results.write_attempt(
            self.root, unit, chunks, environment, self._computation.durable
        )
        name = unit_results.file_name(unit.stage, unit.number)
        seconds = time.perf_counter() - began
        return Receipt(name, path, size, checksum, seconds, host_name(), environment)

    def _layout(self, path: str) -> Layout:
        if path not in self._layouts:
            array = stored_array.open_read(self.root / layout.RUNS / path, self.root)
            self._layouts[path] = array.layout
        return self._layouts[path]

    def backends(self, run: Run) -> tuple[Backend, Backend]:
        """The backends of a run's predictions and of its heatmaps."""
        name, chosen = run.network("precompute"), self._computation.backends
        if name not in self._backends:
            assert chosen is not None
            model = load_model(self.store, name, self._computation.trust)
            self._backends = {name: chosen.open(model, self.threads)}
        return self._backends[name]


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


def open_generation(root: Path, generation: int) -> Store:
    """Open a store in a generation or a later one, which another host may just have published."""
    deadline = time.monotonic() + GENERATION_SECONDS
    while True:
        store = s2rstore.open(root)
        if store.generation >= generation:
            return store
        store.close()
        if time.monotonic() >= deadline:
            raise RequestError(
                f"{root}: {host_name()} reads generation {store.generation}, {generation} is "
                "published; check how the folder is mounted there"
            )
        time.sleep(0.5)
