"""Units of a small store that compute in milliseconds, and record which worker computed them."""

import os
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from s2rstore.files import layout
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rtools.precompute import unit_results
from s2rtools.precompute.tasks.map_grids import merge_grids
from s2rtools.precompute.unit_computer import Machine, encoded
from s2rtools.precompute.unit_plan import UnitPlan
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit
from tests.support import tiny

ROWS = 64
_AXES = ("iid", "x")

started: list[int] = []
"""The numbers of the units that were begun in this process."""
on_start: dict[int, Callable[[], object]] = {}
"""What is called in this process when the unit of a number is begun."""


@dataclass(frozen=True)
class CountedComputation:
    """Computes rows that hold the numbers of their instances."""

    root: Path
    seconds: float = 0.0
    gpu_stage: str = ""
    fails: int | None = None
    durable: bool = False
    identity: str = ""
    host: str = field(default="host", compare=False)

    def open(self, threads: int) -> Callable[[WorkUnit], Receipt]:
        def compute(unit: WorkUnit) -> Receipt:
            started.append(unit.number)
            on_start.get(unit.number, lambda: None)()
            time.sleep(self.seconds)
            if unit.number == self.fails:
                raise OSError(28, os.strerror(28), str(self.root))
            rows = np.array(unit.instances, dtype=np.float32)[:, None] * np.ones(2, np.float32)
            layouts = {s.path("run"): s.open_array(self.root, "run").layout for s in unit.missing}
            chunks = encoded(unit, dict.fromkeys(unit.missing, rows), layouts.__getitem__)
            environment = self.environment(unit.stage, Machine("processor", "", ()), threads)
            attempt = unit_results.write_attempt(self.root, unit, chunks, environment)
            name = unit_results.file_name(unit.stage, unit.number)
            return Receipt(name, *attempt, self.seconds, self.host, environment)

        return compute

    def uses_gpu(self, stage: Stage) -> bool:
        return stage.name == self.gpu_stage

    def environment(self, stage: Stage, machine: Machine, threads: int) -> ComputeEnvironment:
        machine = Machine("processor", machine.gpu, ())
        return machine.environment("float32", threads, self.uses_gpu(stage))


def stage_of(name: str, unit_rows: int = 4) -> Stage:
    key = f"{abs(hash(name)) % 10**16:016d}"
    spec = ArraySpec("heat", "sim", name, (2,), "float32", _AXES, "m", key, ROWS)
    return Stage(name, "run", (spec,), unit_rows)


@cache
def _folder_of_index() -> tempfile.TemporaryDirectory[str]:
    """A folder with a small store, whose index those of the tests are copies of."""
    folder = tempfile.TemporaryDirectory()
    tiny.build(Path(folder.name) / "small.s2r", 4, runs=())
    return folder


def plan_of(root: Path, *stages: Stage) -> UnitPlan:
    if not (root / layout.CURRENT).exists():
        index = Path(_folder_of_index().name) / "small.s2r"
        shutil.copytree(index / layout.INDEX, root / layout.INDEX)
        shutil.copy(index / layout.CURRENT, root)
    return UnitPlan(root, stages, (), merge_grids)


def assert_complete(root: Path, *stages: Stage) -> None:
    expected = np.arange(ROWS, dtype=np.float32)[:, None] * np.ones(2, np.float32)
    for stage in stages:
        np.testing.assert_array_equal(stage.specs[0].open_array(root, "run")[:], expected)
