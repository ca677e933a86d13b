"""Planning of runs in a store of 100 runs of 10^6 instances: `python -m bench planning`.

A second store has few runs and many parts, as one to which a lab appends every week.

The index is that of `growth`; the arrays of every run are created as the planner wants them, their
shards are empty files, because planning reads none. The planner is the real one.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

import s2rstore
from bench import growth
from bench.budget import BudgetRow, seconds
from s2rstore.files import layout
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rtools.counterfactual.depth_tolerance import DepthTolerance
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.models.load_model import model_outline
from s2rtools.precompute import (
    backend_choice,
    domain_calibration,
    pipeline,
    publish_results,
    unit_results,
)
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.run_backends import BackendIdentity, RunBackends
from s2rtools.precompute.run_stages import RunStages, model_run_stages
from s2rtools.precompute.unit_computer import encoded, this_machine
from s2rtools.precompute.unit_plan import UnitPlan
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import ArraySpec, Stage

RUNS = 100
NEW_RUN = "unfinished"
_TORCH = BackendIdentity("torch", "float32")
_BACKENDS = RunBackends(_TORCH, _TORCH, "float32")
_APPENDED_RUNS, _PARTS, _LAST = 4, 52, 10
_UNIT_ROWS, _UNITS, _ARRAYS = 64, 256, 13


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Measure a store that is built in `folder`."""
    yield from _commit()
    count, measured = _planned(folder / "planning.s2r", RUNS, 1)
    yield BudgetRow("files of one run of 1e+06 instances", count, "files", 2_000)
    store = f"{RUNS} runs of 1e+06 instances"
    yield BudgetRow(f"{store}: plan all, which are complete", measured["complete"], "s", 15.0)
    yield BudgetRow(f"{store}: plan one more run", measured["one"], "s", 1.0)
    yield BudgetRow(f"{store}: memory of planning", measured["megabytes"], "MB", 2_000)
    count, measured = _planned(folder / "appended.s2r", _APPENDED_RUNS, _PARTS)
    store = f"{_PARTS} parts of 1e+06 instances"
    yield BudgetRow(f"{store}: files of one run", count, "files", 2_000)
    taken = measured["complete"] / (_APPENDED_RUNS - 1)
    yield BudgetRow(f"{store}: plan a complete run", taken, "s", 5.0)


def _planned(path: Path, runs: int, parts: int) -> tuple[int, dict[str, float]]:
    """Build a store; the number of files of one run, and the result of `measure` on the store."""
    root = growth.store_of_runs(path, runs)
    if parts > 1:
        _split(root, parts)
    count = _create_arrays(root, runs)
    command = [sys.executable, "-m", "bench.planning", str(root)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return count, json.loads(done.stdout.splitlines()[-1])


def _split(root: Path, parts: int) -> None:
    """Declare that the instances were ingested in some parts, the last of which is not merged."""
    ends = [(growth.INSTANCES - _LAST) * part // (parts - 1) for part in range(parts)]
    ends.append(growth.INSTANCES)
    with edit(root) as draft:
        for part, (first, stop) in enumerate(pairwise(ends)):
            row = {"part": part, "first_iid": first, "instances": stop - first}
            draft.insert_row("part", {**row, "hash": f"{part:064x}"})


def _stages(store: Store, hashes: InputHashes, name: str) -> RunStages:
    run = store.run(name)
    model = model_outline(store, run.model)
    kinds = [kind for kind in HEATMAP_KINDS if HEATMAP_KINDS[kind].suits(model)]
    return model_run_stages(store, hashes, run, model, _BACKENDS, kinds, False)


def _create_arrays(root: Path, runs: int) -> int:
    """Create and list the arrays of all runs but the last; gives the number of files of one."""
    offset = {"height": 0.0, "zoom": 1.0, "frames": 1, "version": domain_calibration.VERSION}
    tolerance = asdict(DepthTolerance(0.02, 0.01, 0.3, 8.0))
    with edit(root) as draft:
        draft.set_provenance("alignment:sim|real", offset)
        version = domain_calibration.TOLERANCE_VERSION
        draft.set_provenance("depth_tolerance:sim|real", {**tolerance, "version": version})
        draft.update("run", {"run": growth.linked_name(runs - 1)}, {"run": NEW_RUN})
    files = 0
    with s2rstore.open(root) as store, edit(root) as draft:
        hashes = InputHashes(store)
        for name in store.runs:
            inputs = backend_choice._input_key(store, store.run(name))
            draft.set_provenance(
                f"run:{name}", {"backend": replace(_BACKENDS, facts={"inputs": inputs}).record()}
            )
            if name == NEW_RUN:
                continue
            created = 0
            for stage in _stages(store, hashes, name).rounds[-1].published:
                for spec in stage.specs:
                    array = stage.create(root, spec)
                    for shard in range(array.layout.shards):
                        (root / array.file(shard)).touch()
                    created += array.layout.shards + 1
                    row = publish_results.array_row(root, name, spec)
                    draft.insert_row("zarr_array", row)
            keys = {path.name for path in (root / layout.RUNS / name).iterdir()}
            files = created + len(keys)  # one file of the ledger for each key
    return files


class _Silent:
    """A reporter that collects lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def begin(self, what: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None:
        self.lines.append(line)


def measure(root: Path) -> dict[str, float]:
    """Seconds of planning all complete runs and one more, and the peak of memory in megabytes."""
    with s2rstore.open(root) as store:
        complete = [name for name in store.runs if name != NEW_RUN]
    began = time.perf_counter()
    reporter = _Silent()
    published = pipeline.precompute(root, reporter, complete)
    middle = time.perf_counter()
    if published or not all(line.endswith("up to date") for line in reporter.lines):
        raise SystemExit(f"not up to date: {reporter.lines[:3]}")
    with s2rstore.open(root) as store:
        hashes = InputHashes(store)
        _stages(store, hashes, complete[0])
        planned = time.perf_counter()
        for planned_round in _stages(store, hashes, NEW_RUN).rounds:
            for group in planned_round.groups:
                UnitPlan(root, group, store.array_paths, dict)
        end = time.perf_counter()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"complete": middle - began, "one": end - planned, "megabytes": peak}


def _commit() -> Iterator[BudgetRow]:
    """Milliseconds to compress, and to write and record, a unit of heatmaps."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        specs = tuple(_spec(number) for number in range(_ARRAYS))
        stage = Stage("commit", "run", specs, _UNIT_ROWS)
        rows = rng.normal(size=(_UNIT_ROWS, 2, 6, 6)).astype(np.float32)
        plan = UnitPlan(root, [stage], (), dict)
        layouts = {spec.path("run"): stage.create(root, spec).layout for spec in specs}
        units: Sequence = plan.units
        values = dict.fromkeys(specs, rows)
        encoding = seconds(lambda: encoded(units[0], values, layouts.__getitem__), 20)
        chunks = encoded(units[0], values, layouts.__getitem__)
        environment = this_machine().environment("float32", 1)
        began = time.perf_counter()
        for unit in units:
            name = unit_results.file_name(stage, unit.number)
            attempt = unit_results.write_attempt(root, unit, chunks, environment)
            plan.finish(Receipt(name, *attempt, 0.0, "", environment))
        plan.close()
        taken = time.perf_counter() - began
    unit_name = f"unit of {_ARRAYS} arrays"
    yield BudgetRow(f"compress a {unit_name}", 1000 * encoding, "ms")
    yield BudgetRow(f"commit of a {unit_name}", 1000 * taken / len(units), "ms", 1.0)


def _spec(number: int) -> ArraySpec:
    key = f"{number:016x}"
    axes = ("iid", "unit", "row", "column")
    rows = _UNIT_ROWS * _UNITS
    return ArraySpec("heat", "sim", f"m{number}", (2, 6, 6), "float32", axes, "m", key, rows)


if __name__ == "__main__":
    print(json.dumps(measure(Path(sys.argv[1]))))
