"""The backends of a run are chosen once, recorded, reported and kept."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.inference import MeasuredBackend, open_backend
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute import backend_choice, pipeline
from s2rtools.precompute.executors import local_executors
from s2rtools.precompute.executors.executor import Task
from s2rtools.precompute.executors.local_executors import (
    LocalExecutor,
    ProcessExecutor,
    SerialExecutor,
    WorkerPool,
)
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_backends import BackendIdentity, RunBackends
from s2rtools.precompute.unit_computer import Computation
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit
from tests.support.silent_reporter import SilentReporter

KINDS = ("feature_distance",)


@pytest.fixture
def store(small_copy: Path) -> Path:
    return small_copy


@pytest.fixture
def bfloat16_is_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    def choose(model: LoadedModel, sample: object, name: str, threads: int) -> MeasuredBackend:
        name = "torch-bfloat16" if name == "auto" else name
        return MeasuredBackend(open_backend(model, name, threads), 0.0004, 0.00035)

    monkeypatch.setenv(backend_choice.DEFAULT_VARIABLE, "auto")
    monkeypatch.setattr(backend_choice, "choose_backend", choose)


def compute(path: Path, backend: str = "auto", kinds: tuple[str, ...] = KINDS) -> list[str]:
    reporter = SilentReporter()
    precompute(path, reporter, ["vanilla"], PrecomputeOptions(kinds, backend=backend))
    return reporter.lines


def record(path: Path) -> dict[str, Any]:
    with s2rstore.open(path) as opened:
        return json.loads(opened.provenance("run:vanilla")["backend"])


@pytest.mark.usefixtures("bfloat16_is_preferred")
def test_the_choice_is_reported_recorded_and_kept(store, monkeypatch):
    monkeypatch.setattr(backend_choice, "HEATMAP_ERROR", 1.0)
    lines = compute(store)
    assert lines[0].startswith("vanilla: torch bfloat16, at most 0.4 mm and 0.02 degrees off")
    facts = record(store)
    assert facts["predictions"] == {"name": "torch-bfloat16", "precision": "bfloat16"}
    assert {"metres", "radians", "library", "device"} <= set(facts["facts"])

    def never(*given: object) -> None:
        raise AssertionError("the recorded choice is kept")

    monkeypatch.setattr(backend_choice, "choose_backend", never)
    assert compute(store) == ["vanilla: up to date"]


@pytest.mark.usefixtures("bfloat16_is_preferred")
def test_a_run_in_float32_stays_in_float32_unless_a_backend_is_named(store):
    compute(store, "torch")
    assert compute(store) == ["vanilla: up to date"]
    assert record(store)["predictions"]["name"] == "torch"
    compute(store, "torch-bfloat16")
    assert record(store)["predictions"]["name"] == "torch-bfloat16"


@pytest.mark.usefixtures("bfloat16_is_preferred")
@pytest.mark.parametrize("backend", ["torch-bfloat16", "auto"])
def test_heatmaps_stay_in_float32_where_reduced_precision_changes_them(store, monkeypatch, backend):
    monkeypatch.setattr(backend_choice, "HEATMAP_ERROR", 0.0)
    lines = compute(store, backend, KINDS)
    assert record(store)["predictions"]["name"] == "torch-bfloat16"
    assert record(store)["heatmaps"] == {"name": "torch", "precision": "float32"}
    assert lines[0].endswith("; heatmaps in torch float32")


def test_the_recorded_precision_must_be_available():
    from tests.support import networks

    identity = BackendIdentity("torch", "float64")
    with pytest.raises(RequestError, match="--backend torch"):
        identity.open(networks.build_model("resposenet"), 1)


def test_one_process_uses_the_gpu(monkeypatch):
    monkeypatch.setattr(local_executors, "available_processors", lambda: 8)
    for kind in (SerialExecutor, ProcessExecutor):
        monkeypatch.setattr(kind, "run", lambda executor, tasks: [type(executor), *tasks])
    gpu, torch = BackendIdentity("cuda", "float32"), BackendIdentity("torch", "float32")
    spec = ArraySpec("heat", "sim", None, (2,), "float32", ("iid", "x"), "m", "a" * 16, 80)
    for backends, name, workers in (
        (RunBackends(gpu, gpu), "forward", 1),
        (RunBackends(torch, gpu), "occlusion", 1),
        (RunBackends(gpu, torch), "occlusion", 8),
        (RunBackends(gpu, gpu), "maps", 8),
        (RunBackends(torch, torch), "forward", 8),
    ):
        computation = Computation(Path(), 1, backends)
        units = [WorkUnit(Stage(name, "run", (spec,), 1), number, ()) for number in range(80)]
        tasks = [Task(computation, unit) for unit in units]
        executor, *computed = LocalExecutor(WorkerPool(), 8, None).run(tasks)
        assert (executor is ProcessExecutor) == (workers > 1)
        assert computed == tasks


def test_keys_of_heatmaps_name_the_precision_of_differences():
    torch = BackendIdentity("torch", "float32")
    assert RunBackends(torch, torch, "float32").kind_facts("occlusion") == torch.facts()
    reduced = RunBackends(torch, torch, "bfloat16")
    assert reduced.kind_facts("occlusion") == {**torch.facts(), "differences": "bfloat16"}
    assert reduced.kind_facts("activation") == torch.facts()


@pytest.mark.parametrize(
    ("errors", "units", "chosen"),
    [((0.008, 0.004), True, "bfloat16-broad"), ((0.012, 0.004), True, "bfloat16"),
     ((0.012, 0.011), True, None), ((0.008, 0.004), False, None)],
)  # fmt: skip
def test_differences_take_the_first_accurate_precision_where_the_processor_has_units_for_it(
    errors, units, chosen, monkeypatch
):
    error = dict(zip(("bfloat16-broad", "bfloat16"), errors, strict=True), float32=0.0)
    exact = np.array([-1.0, 1.0]).repeat(8).reshape(1, 1, 4, 4)

    class Kind:
        def compute(self, pair: SimpleNamespace) -> dict[tuple[str, str], np.ndarray]:
            return {("sim", "rgb"): exact + error[pair.backend.differences]}

    class Sample:
        def pairs(self, backend: SimpleNamespace, places: int) -> list[SimpleNamespace]:
            return [SimpleNamespace(backend=backend)] * places

    monkeypatch.setattr(backend_choice, "has_bfloat16_units", lambda: units)
    backend = SimpleNamespace(device=SimpleNamespace(type="cpu"), differences="float32")
    found = backend_choice._reduced_differences(Kind(), Sample(), backend)  # type: ignore[arg-type]
    assert (found and found[0]) == chosen
    if found:
        assert found[1] == pytest.approx(error[found[0]])


def test_an_interrupted_run_continues_with_the_backend_that_it_began_with(store, monkeypatch):
    """Whatever the machine prefers when the command is repeated, one run has one backend."""
    monkeypatch.setenv(backend_choice.DEFAULT_VARIABLE, "auto")
    machine = ["torch-bfloat16"]

    def choose(model: LoadedModel, sample: object, name: str, threads: int) -> MeasuredBackend:
        return MeasuredBackend(open_backend(model, machine[0], threads), 0.0, 0.0)

    monkeypatch.setattr(backend_choice, "choose_backend", choose)
    monkeypatch.setattr(backend_choice, "HEATMAP_ERROR", 1.0)
    publish = pipeline.publish_run

    def interrupted(*given: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "publish_run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        compute(store)
    machine[0] = "torch"
    monkeypatch.setattr(pipeline, "publish_run", publish)
    compute(store)
    assert record(store)["predictions"]["name"] == "torch-bfloat16"
    assert record(store)["heatmaps"] == {"name": "torch-bfloat16", "precision": "bfloat16"}


def test_a_value_that_is_not_finite_is_an_error_without_bound():
    expected = np.random.default_rng(0).normal(size=(2, 3, 4, 4)).astype(np.float32)
    expected[1, 2, 0, 0] = np.nan
    assert backend_choice._relative_errors(expected, expected) == [0.0, 0.0, 0.0]
    values = expected.copy()
    values[0, 1, 2, 2] = np.nan
    assert backend_choice._relative_errors(values, expected) == [0.0, np.inf, 0.0]
    values[...] = np.nan
    assert backend_choice._relative_errors(values, values) == [0.0, 0.0, 0.0]
