"""Results of units: only intact results of the same instances become shards."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from s2rstore.arrays import array_writer, stored_array
from s2rstore.arrays.stored_array import codec
from s2rstore.errors import RequestError
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rstore.files.ledger import Ledger
from s2rtools.precompute import unit_results
from s2rtools.precompute.tasks.map_grids import merge_grids
from s2rtools.precompute.unit_computer import encoded
from s2rtools.precompute.unit_plan import UnitPlan
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

HERE = ComputeEnvironment("processor", "float32", 2, {"numpy": "2.0"})
ROWS = 50
ITEM = (3, 5)


def spec_of(name: str, rows: int = ROWS, kind: str = "heat") -> ArraySpec:
    axes = ("iid", "row", "column")
    return ArraySpec(kind, "sim", name, ITEM, "float32", axes, "m", "a" * 16, rows)


def stage_of(unit_rows: int, *names: str) -> Stage:
    return Stage("heat", "run", tuple(map(spec_of, names or ("x", "y"))), unit_rows)


def values_of(stage: Stage) -> dict[ArraySpec, np.ndarray]:
    rng = np.random.default_rng(3)
    return {spec: rng.normal(size=(ROWS, *ITEM)).astype(np.float32) for spec in stage.specs}


def plan_of(root: Path, stage: Stage, published: tuple[str, ...] = ()) -> UnitPlan:
    return UnitPlan(root, [stage], published, merge_grids)


def written(root: Path, unit: WorkUnit, environment: ComputeEnvironment = HERE) -> Receipt:
    """Write the result of a unit under a unique name."""
    rows = slice(unit.instances.start, unit.instances.stop)
    values = {spec: values_of(unit.stage)[spec][rows] for spec in unit.missing}
    layouts = {spec.path("run"): spec.open_array(root, "run").layout for spec in unit.missing}
    chunks = encoded(unit, values, layouts.__getitem__)
    path, size, checksum = unit_results.write_attempt(root, unit, chunks, environment)
    name = unit_results.file_name(unit.stage, unit.number)
    return Receipt(name, path, size, checksum, 0.0, "host", environment)


def compute(root: Path, unit: WorkUnit, environment: ComputeEnvironment = HERE) -> None:
    """Write the result of a unit, as a process did that ended then."""
    unit_results.accept(root, unit, written(root, unit, environment))


def finish(root: Path, plan: UnitPlan) -> None:
    for unit in plan.units:
        assert plan.finish(written(root, unit)) is unit
    plan.close()


def assert_complete(root: Path, stage: Stage) -> None:
    for spec, expected in values_of(stage).items():
        np.testing.assert_array_equal(spec.open_array(root, "run")[:], expected)
    assert not list((root / "units").iterdir())
    assert plan_of(root, stage).units == []


@pytest.mark.parametrize("unit_rows", [1, 7, 16, 64])
@pytest.mark.parametrize("shard_rows", [16, 16_384])
def test_units_of_any_size_make_the_same_arrays(tmp_path, monkeypatch, unit_rows, shard_rows):
    monkeypatch.setattr(array_writer, "SHARD_ROWS", shard_rows)
    stage = stage_of(unit_rows)
    finish(tmp_path, plan_of(tmp_path, stage))
    assert_complete(tmp_path, stage)
    ledger = Ledger(tmp_path)
    assert all(ledger.proves(entries) for entries in ledger.by_path().values())


def test_results_of_an_earlier_process_are_used(tmp_path):
    stage = stage_of(8)
    first = plan_of(tmp_path, stage).units
    for unit in first[:3]:
        compute(tmp_path, unit)
    plan = plan_of(tmp_path, stage)
    assert plan.units == first[3:]
    finish(tmp_path, plan)
    assert_complete(tmp_path, stage)


def test_results_of_other_instances_are_computed_again(tmp_path):
    for unit in plan_of(tmp_path, stage_of(8)).units:
        compute(tmp_path, unit)
    stage = stage_of(16)
    plan = plan_of(tmp_path, stage)
    assert len(plan.units) == 4
    finish(tmp_path, plan)
    assert_complete(tmp_path, stage)


def test_results_without_a_missing_array_are_computed_again(tmp_path):
    stage = stage_of(8, "x")
    for unit in plan_of(tmp_path, stage).units:
        compute(tmp_path, unit)
    assert len(plan_of(tmp_path, stage_of(8, "x", "y")).units) == 7


def result_file(
    root: Path, stage: Stage, chunks: dict[str, list[bytes]], **changes: object
) -> Path:
    """Write a result with a valid checksum and the given entries of its header."""
    content = b"".join(chunk for parts in chunks.values() for chunk in parts)
    header = {
        "version": 2,
        "first_iid": 0,
        "instances": 8,
        "environment": msgspec.to_builtins(HERE),
        "chunks": {path: list(map(len, parts)) for path, parts in chunks.items()},
        "sha256": hashlib.sha256(content).hexdigest(),
        **changes,
    }
    path = root / unit_results.file_name(stage, 0)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(json.dumps(header).encode() + b"\n" + content)
    return path


def bomb() -> bytes:
    """A chunk of a few bytes that decompresses to 64 MB."""
    return bytes(codec("float32").encode(np.zeros(16 * 2**20, np.float32)))


@pytest.mark.parametrize("defect", ["none", "cut", "bit", "bomb", "no blosc", "version", "line"])
def test_damaged_results_are_computed_again(tmp_path, defect):
    stage = stage_of(8, "x")
    (spec,) = stage.specs
    plan = plan_of(tmp_path, stage)
    unit, path = plan.units[0], spec.path("run")
    layout = spec.open_array(tmp_path, "run").layout
    good = encoded(unit, {spec: values_of(stage)[spec][:8]}, lambda _: layout)
    chunks = {"bomb": {path: [bomb()]}, "no blosc": {path: [b"x" * 40]}}.get(defect, good)
    changes = {"version": 3} if defect == "version" else {}
    file = result_file(tmp_path, stage, chunks, **changes)
    content = file.read_bytes()
    if defect == "cut":
        file.write_bytes(content[:-1])
    if defect == "bit":
        file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    if defect == "line":
        file.write_bytes(content.replace(b"\n", b" ", 1))
    again = plan_of(tmp_path, stage)
    assert (again.units == plan.units) == (defect != "none")
    finish(tmp_path, again)
    assert_complete(tmp_path, stage)


def test_totals_of_another_size_are_not_decompressed(tmp_path):
    heat = spec_of("x", kind="prediction")
    grid = replace(spec_of("x", 4, "map:heat"), axes=("aggregate", "row", "column"))
    stage = Stage("maps", "run", (grid,), 64, (heat,), aggregated=range(ROWS))
    path = grid.path("run")
    assert len(plan_of(tmp_path, stage).units) == 1
    result_file(tmp_path, stage, {path: [bomb()]}, instances=ROWS)
    plan = plan_of(tmp_path, stage)
    assert len(plan.units) == 1
    totals = np.zeros((3, *ITEM))
    result_file(tmp_path, stage, {path: unit_results.encode_totals(totals)}, instances=ROWS)
    assert plan_of(tmp_path, stage).units == []
    assert np.isnan(grid.open_array(tmp_path, "run")[:3]).all()


def test_a_shard_of_another_size_than_recorded_is_computed_again(tmp_path):
    stage = stage_of(8)
    finish(tmp_path, plan_of(tmp_path, stage))
    shard = tmp_path / stage.specs[1].open_array(tmp_path, "run").file(0)
    shard.write_bytes(shard.read_bytes()[:-1])
    assert len(plan_of(tmp_path, stage).units) == 7


@pytest.mark.parametrize("rows", [1, 97, 10_007, 100_003])
def test_arrays_in_one_shard_have_chunks_of_many_rows(rows):
    layout = array_writer.plan_whole(rows, (50,), "float32")
    assert layout.shards == 1
    assert layout.shard_rows % layout.rows_per_chunk == 0
    assert layout.rows_per_chunk == min(rows, 1310)


def test_arrays_with_other_chunks_are_refused(tmp_path):
    stage = stage_of(8, "x")
    (spec,) = stage.specs
    other = array_writer.plan_layout(ROWS, ITEM, "float32", 15, 5)
    array_writer.create(tmp_path / "runs.zarr" / spec.path("run"), other, {}, tmp_path)
    with pytest.raises(RequestError, match="begun by another release"):
        plan_of(tmp_path, stage)
    assert stored_array.open_read(tmp_path / "runs.zarr" / spec.path("run")).layout == other


OTHERS = {
    "device GPU instead of processor": {"device": "GPU"},
    "precision bfloat16 instead of float32": {"precision": "bfloat16"},
    "threads 1 instead of 2": {"threads": 1},
    "numpy 2.1 instead of 2.0": {"versions": {"numpy": "2.1"}},
    "torch 3 instead of none": {"versions": {"numpy": "2.0", "torch": "3"}},
}


@pytest.mark.parametrize("reason", OTHERS)
@pytest.mark.parametrize("is_stored", [False, True])
def test_an_array_is_not_computed_in_two_environments(tmp_path, monkeypatch, reason, is_stored):
    """The first values are results of units, or, if `is_stored`, a shard."""
    monkeypatch.setattr(array_writer, "SHARD_ROWS", 16)
    stage = stage_of(8)
    other = msgspec.structs.replace(HERE, **OTHERS[reason])
    units = plan_of(tmp_path, stage).units
    plan = plan_of(tmp_path, stage)
    for unit in units[: 2 if is_stored else 1]:
        plan.finish(written(tmp_path, unit))
    again = plan_of(tmp_path, stage)
    assert all(again.environment(unit, "float32") == HERE for unit in again.units)
    with pytest.raises(RequestError, match=f"heat: {reason}"):
        again.finish(written(tmp_path, units[3], other))
    finish(tmp_path, plan_of(tmp_path, stage))
    assert_complete(tmp_path, stage)
    entries = Ledger(tmp_path).by_path().values()
    assert all(entry.environment == HERE for found in entries for entry in found)


def test_a_lost_shard_of_a_published_array_is_computed_again_in_its_environment(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(array_writer, "SHARD_ROWS", 16)
    stage = stage_of(8)
    finish(tmp_path, plan_of(tmp_path, stage))
    published = tuple(spec.path("run") for spec in stage.specs)
    (tmp_path / stage.specs[0].open_array(tmp_path, "run").file(1)).unlink()
    plan = plan_of(tmp_path, stage, published)
    assert {unit.missing for unit in plan.units} == {stage.specs[:1]}
    assert [plan.environment(unit, "float32") for unit in plan.units] == [HERE, HERE]
    other = msgspec.structs.replace(HERE, device="GPU")
    with pytest.raises(RequestError, match="heat: device GPU instead of processor"):
        plan.finish(written(tmp_path, plan.units[0], other))
    finish(tmp_path, plan_of(tmp_path, stage, published))
    assert_complete(tmp_path, stage)


def test_arrays_of_all_runs_do_not_depend_on_the_precision_of_a_network(tmp_path):
    """Images alone make them, whatever else the units of their stage compute."""
    shared = replace(spec_of("x"), key="b" * 16, is_shared=True)
    stage = Stage("forward", "run", (shared,), 8)
    plan = plan_of(tmp_path, stage)
    plan.finish(written(tmp_path, plan.units[0]))
    plan = plan_of(tmp_path, stage)
    reduced = msgspec.structs.replace(HERE, precision="openvino bf16")
    assert plan.environment(plan.units[0], reduced.precision) == reduced
    for unit in plan.units:
        plan.finish(written(tmp_path, unit, reduced))
    plan.close()
    assert_complete(tmp_path, stage)
    (entries,) = Ledger(tmp_path).by_path().values()
    assert {entry.environment.precision for entry in entries} == {"numpy"}


def test_other_arrays_may_have_another_environment(tmp_path):
    other = msgspec.structs.replace(HERE, threads=7)
    for key, environment in (("a", HERE), ("b", other)):
        spec = replace(spec_of("x"), key=16 * key)
        stage = Stage("heat", "run", (spec,), 64)
        plan = plan_of(tmp_path, stage)
        assert plan.environment(plan.units[0], "float32") is None
        plan.finish(written(tmp_path, plan.units[0], environment))
        plan.close()


@pytest.mark.parametrize("defect", ["bytes", "sha256", "path", "content"])
def test_a_result_that_is_not_what_its_receipt_states_is_refused(tmp_path, monkeypatch, defect):
    monkeypatch.setattr(unit_results, "VISIBLE_SECONDS", 0.0)
    stage = stage_of(8)
    plan = plan_of(tmp_path, stage)
    receipt = written(tmp_path, plan.units[0])
    changes = {"bytes": receipt.bytes + 1, "sha256": "0" * 64, "path": "units/run/x/0"}
    if defect == "content":
        file = tmp_path / receipt.path
        content = file.read_bytes()
        file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    else:
        receipt = msgspec.structs.replace(receipt, **{defect: changes[defect]})
    with pytest.raises(RequestError, match=r"host|not a result"):
        plan.finish(receipt, is_checked=True)


def test_a_result_that_appears_late_is_used(tmp_path, monkeypatch):
    """Folders are cached on other hosts."""
    stage = stage_of(64)
    plan = plan_of(tmp_path, stage)
    receipt = written(tmp_path, plan.units[0])
    (tmp_path / receipt.path).rename(tmp_path / "hidden")
    waits = []

    def appear(seconds: float) -> None:
        waits.append(seconds)
        (tmp_path / "hidden").rename(tmp_path / receipt.path)

    monkeypatch.setattr(unit_results.time, "sleep", appear)
    plan.finish(receipt)
    plan.close()
    assert len(waits) == 1
    assert_complete(tmp_path, stage)


def test_two_workers_may_compute_one_unit(tmp_path):
    """The first was believed to be lost; its file goes with the folder."""
    stage = stage_of(64)
    plan = plan_of(tmp_path, stage)
    late, used = written(tmp_path, plan.units[0]), written(tmp_path, plan.units[0])
    assert late.path != used.path
    plan.finish(used)
    plan.close()
    assert_complete(tmp_path, stage)
    with pytest.raises(FileNotFoundError):
        written(tmp_path, replace(plan.units[0]))
