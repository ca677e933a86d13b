"""Executors of a Dask cluster on this machine: overhead per unit, efficiency, equal results."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench import index_store
from bench.budget import BudgetRow
from bench.measured_stores import QUIET, frames_store, lively
from s2rstore.files import layout
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rstore.files.ledger import Ledger
from s2rtools.common.processors import available_processors
from s2rtools.precompute import unit_results
from s2rtools.precompute.executors.clusters import open_cluster
from s2rtools.precompute.executors.executor import Executor, Task
from s2rtools.precompute.executors.local_executors import (
    ProcessExecutor,
    SerialExecutor,
    WorkerPool,
)
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.unit_computer import Machine, encoded
from s2rtools.precompute.unit_plan import UnitPlan
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

_KINDS = ("feature_distance", "occlusion")
_PAIRS, _WARM_PAIRS, _SIZE = 768, 256, 64
_SHORT, _LONG = 400, 0.1
_MANY = 8
"""A step of fewer units is not counted: workers without a unit say nothing about the executor."""


@dataclass(frozen=True)
class _Sleep:
    """Sleeps, so that computing and compressing its small arrays takes `seconds`."""

    root: Path
    seconds: float
    durable: bool = False
    identity: str = ""

    def open(self, threads: int) -> Callable[[WorkUnit], Receipt]:
        def compute(unit: WorkUnit) -> Receipt:
            end = time.perf_counter() + self.seconds
            rows = np.zeros((len(unit.instances), 6, 6), np.float32)
            layouts = {s.path("run"): s.open_array(self.root, "run").layout for s in unit.missing}
            chunks = encoded(unit, dict.fromkeys(unit.missing, rows), layouts.__getitem__)
            environment = self.environment(unit.stage, Machine("", "", ()), threads)
            time.sleep(max(0.0, end - time.perf_counter()))
            attempt = unit_results.write_attempt(self.root, unit, chunks, environment, self.durable)
            name = unit_results.file_name(unit.stage, unit.number)
            return Receipt(name, *attempt, self.seconds, "", environment)

        return compute

    def uses_gpu(self, stage: Stage) -> bool:
        return False

    def environment(self, stage: Stage, machine: Machine, threads: int) -> ComputeEnvironment:
        return ComputeEnvironment("none", "float32", threads, {})


class _Timed:
    """Adds up the wall time and the stated seconds of an executor, over steps of many units."""

    def __init__(self, executor: Executor) -> None:
        self._executor, self.is_remote = executor, executor.is_remote
        self.wall = self.computed = 0.0

    def run(self, tasks: Iterable[Task]) -> Iterator[Receipt]:
        tasks = list(tasks)
        is_counted, began = len(tasks) >= _MANY, time.perf_counter()
        for receipt in self._executor.run(tasks):
            self.computed += is_counted * receipt.seconds
            yield receipt
        self.wall += is_counted * (time.perf_counter() - began)


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Workers are started and have computed a unit before anything is measured."""
    for workers in (2, 4):
        with open_cluster(f"local:{workers}", None, 1, lambda line: None) as executor:
            _sleep(executor, folder / f"warm{workers}", 4 * workers, 0.0)
            if workers == 2:
                taken = _sleep(executor, folder / "short", _SHORT, 0.0)
                yield BudgetRow("overhead of an executor", 1000 * taken / _SHORT, "ms/unit", 5.0)
            count = 50 * workers
            taken = _sleep(executor, folder / f"long{workers}", count, _LONG)
            name = f"efficiency of {workers} workers, units of {1000 * _LONG:.0f} ms"
            yield BudgetRow(name, count * _LONG / workers / taken, "ratio", 0.95, "at least")
    yield from _real(folder)


def _sleep(executor: Executor, root: Path, count: int, seconds: float) -> float:
    """Seconds in which an executor computes and this process accepts `count` units."""
    index_store.build(root, 100, runs=())
    axes = ("iid", "row", "column")
    spec = ArraySpec("heat", "sim", None, (6, 6), "float32", axes, "m", "0" * 16, 64 * count)
    plan = UnitPlan(root, [Stage("heat", "run", (spec,), 64)], (), dict)
    computation = _Sleep(root, seconds)
    began = time.perf_counter()
    for receipt in executor.run([Task(computation, unit) for unit in plan.units]):  # type: ignore[arg-type]
        plan.finish(receipt, is_checked=True)
    return time.perf_counter() - began


def _real(folder: Path) -> Iterator[BudgetRow]:
    """Real units with one thread each, of the step with many units: predictions and occlusion.

    They need a processor each, so the efficiency is that of as many workers as have one: the time
    in which one process computes the units, over the workers or processors, whichever are fewer,
    and over the time that the workers take. Processors share caches and memory, so the efficiency
    of as many processes without a cluster is the most that workers can reach.
    """
    warm = frames_store(folder / "warm.s2r", _WARM_PAIRS, _SIZE, lively("resposenet"))
    store = frames_store(folder / "frames.s2r", _PAIRS, _SIZE, lively("resposenet"))
    serial = _Timed(SerialExecutor(1))
    expected = _computed(store, folder / "serial.s2r", serial)

    def row(name: str, executor: Executor, workers: int, *budget: Any) -> Iterator[BudgetRow]:
        _computed(warm, folder / f"warm {name}", executor)
        timed = _Timed(executor)
        shards = _computed(store, folder / name, timed)
        processors = min(workers, available_processors())
        efficiency = serial.computed / processors / timed.wall
        where = f"{name} on {processors} processors, real units"
        yield BudgetRow(f"efficiency of {where}", efficiency, "ratio", *budget)
        differing = sum(expected[path] != shards.get(path) for path in expected)
        yield BudgetRow(f"shards that differ from the serial ones, {where}", differing, "files", 0)

    for workers in (2, 4):
        with WorkerPool() as pool:
            executor: Executor = ProcessExecutor(workers, 1, pool)
            yield from row(f"{workers} processes without a cluster", executor, workers)
        with open_cluster(f"local:{workers}", None, 1, lambda line: None) as executor:
            yield from row(f"{workers} workers", executor, workers, 0.8, "at least")


def _computed(store: Path, path: Path, executor: Executor) -> dict[str, str]:
    """Compute a copy of a store; the checksums of its shards."""
    shutil.copytree(store, path)
    options = PrecomputeOptions(_KINDS, backend="torch", threads=1, executor=executor)
    precompute(path, QUIET, [], options)
    entries = (entry for found in Ledger(path).by_path().values() for entry in found)
    return {entry.path: entry.checksum for entry in entries if entry.path.startswith(layout.RUNS)}
