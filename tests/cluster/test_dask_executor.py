"""The executor of Dask clusters: lost workers, mixed workers, failing units, a lost scheduler."""

import logging
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import pytest

import s2rstore
from bench.support.processes import wait_until
from s2rstore.errors import RequestError
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit
from s2rtools.precompute.executors.executor import RequestedWorkers, Task
from tests.cluster import counted_units
from tests.cluster.counted_units import CountedComputation, assert_complete, plan_of, stage_of

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
from s2rtools.precompute.executors import dask_executor, dask_worker  # noqa: E402
from s2rtools.precompute.executors.clusters import open_cluster  # noqa: E402
from s2rtools.precompute.executors.dask_executor import DaskExecutor  # noqa: E402
from s2rtools.precompute.executors.dask_worker import StoreIdentity  # noqa: E402
from s2rtools.precompute.executors.local_executors import default_threads  # noqa: E402


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_executor, "_POLL_SECONDS", 0.02)
    monkeypatch.setattr(dask_executor, "NO_WORKERS_SECONDS", 0.1)
    counted_units.started.clear()
    counted_units.on_start.clear()


@contextmanager
def cluster(*threads: int) -> Iterator[tuple[Any, Any]]:
    """Dask's scheduler and workers with some threads each, all in this process; and a client."""
    spec = {
        str(number): {"cls": distributed.Worker, "options": {"nthreads": count}}
        for number, count in enumerate(threads)
    }
    scheduler = {"cls": distributed.Scheduler, "options": {"dashboard_address": "127.0.0.1:0"}}
    for options in (scheduler, *spec.values()):
        options["options"]["protocol"] = "inproc://"  # type: ignore[index]
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        distributed.SpecCluster(spec, scheduler, silence_logs=logging.CRITICAL) as started,
        distributed.Client(started, set_as_default=False, timeout=2) as client,
    ):
        yield started, client


def run(
    client: Any,
    computation: CountedComputation,
    *names: str,
    lines: list[str] | None = None,
    on_receipt: Callable[[int], None] = lambda count: None,
) -> None:
    """Compute stages as precompute does."""
    stages = [stage_of(name) for name in names or ("x",)]
    plan = plan_of(computation.root, *stages)
    tasks = [Task(computation, unit, plan.environment(unit, "numpy")) for unit in plan.units]
    report = (lines if lines is not None else []).append
    for count, receipt in enumerate(DaskExecutor(client, report).run(tasks)):
        plan.finish(receipt, is_checked=True)
        on_receipt(count)
    plan.close()
    assert_complete(computation.root, *stages)


def close(started: Any, worker: Any) -> None:
    """End a worker as a lost connection does."""
    scheduler = started.scheduler
    started.sync(scheduler.remove_worker, worker.address, stimulus_id="test", expected=False)


def test_every_task_is_computed_once(tmp_path):
    with cluster(1, 1) as (_, client):
        run(client, CountedComputation(tmp_path), "x", "y")
    assert sorted(counted_units.started) == sorted(2 * [*range(16)])
    assert not list((tmp_path / "units").iterdir())


def test_units_do_not_wait_in_a_slow_worker(tmp_path, monkeypatch):
    """While one worker computes the first unit, the other gets all but the one that waits there."""
    is_shared: list[bool] = []
    with cluster(1, 1) as (_, client):
        run(client, CountedComputation(tmp_path, 0.01))  # opens what both threads use below
        counted_units.started.clear()
        threads: dict[str, ThreadPoolExecutor] = defaultdict(lambda: ThreadPoolExecutor(1))
        monkeypatch.setattr(
            dask_worker, "_computing_thread", lambda: threads[distributed.get_worker().address]
        )
        counted_units.on_start[0] = lambda: is_shared.append(
            wait_until(lambda: len(counted_units.started) >= 15)
        )
        run(client, CountedComputation(tmp_path, 0.01), "y")
    assert is_shared == [True]


@pytest.mark.parametrize("reason", ["threads 2 instead of 1", "threads 1 instead of 2"])
def test_workers_of_another_kind_are_left_out_of_an_array(tmp_path, reason):
    lines: list[str] = []
    threads = (1, 2, 1) if reason.startswith("threads 2") else (2, 1, 2)
    with cluster(*threads) as (_, client):
        run(client, CountedComputation(tmp_path), "x", "y", lines=lines)
    assert sum(f"is left out of run: x: {reason}" in line for line in lines) == 1
    assert sum(f"is left out of run: y: {reason}" in line for line in lines) == 1
    entries = Ledger(tmp_path).by_path().values()
    assert {e.environment.threads for found in entries for e in found} == {threads[0]}


def test_an_array_that_is_begun_refuses_all_workers_of_another_kind(tmp_path):
    plan = plan_of(tmp_path, stage_of("x"))
    plan.finish(CountedComputation(tmp_path).open(3)(plan.units[0]))
    with (
        cluster(1) as (_, client),
        pytest.raises(RequestError, match=r"run: x: threads 1 instead of 3.*--restart") as error,
    ):
        run(client, CountedComputation(tmp_path))
    assert "(`--threads` of local:N, " in str(error.value)


def test_units_of_a_gpu_go_to_workers_with_one(tmp_path):
    with (
        cluster(1) as (_, client),
        pytest.raises(RequestError, match="run: x: no GPU that torch can use"),
    ):
        run(client, CountedComputation(tmp_path, gpu_stage="x"))


def test_tasks_of_a_lost_worker_go_to_others(tmp_path):
    lines: list[str] = []

    def lose(count: int) -> None:
        if count == 2:
            close(started, next(iter(started.workers.values())))

    with cluster(1, 1) as (started, client):
        run(client, CountedComputation(tmp_path, 0.01), lines=lines, on_receipt=lose)
    assert any("was lost" in line for line in lines)


def test_a_unit_that_ends_its_workers_is_told_after_all_others(tmp_path, monkeypatch):
    """Each of its workers is replaced, as SLURM and nannies do."""
    monkeypatch.setattr(dask_executor, "NO_WORKERS_SECONDS", 30.0)
    with cluster(1) as (started, client):
        workers = [*started.workers.values()]

        def replace_worker() -> None:
            close(started, workers[-1])
            workers.append(started.sync(_new_worker, started.scheduler.address))

        counted_units.on_start[3] = replace_worker
        try:
            with pytest.raises(RequestError, match=r"repeatedly .* instances 12 to 15 \(out"):
                run(client, CountedComputation(tmp_path))
        finally:
            close(started, workers[-1])
    assert len(workers) == 1 + dask_executor.MOST_LOSSES
    assert len(plan_of(tmp_path, stage_of("x")).units) == 1


async def _new_worker(address: str) -> Any:
    return await distributed.Worker(address, nthreads=1)


def test_an_error_of_a_unit_names_its_worker(tmp_path):
    with (
        cluster(1) as (_, client),
        pytest.raises(RequestError, match=r"No space left.*\(worker .* on "),
    ):
        run(client, CountedComputation(tmp_path, fails=5))
    assert len(plan_of(tmp_path, stage_of("x")).units) <= 16


def test_a_scheduler_without_workers_is_told(tmp_path):
    lines: list[str] = []
    with (
        cluster() as (_, client),
        pytest.raises(RequestError, match="the scheduler has no workers"),
    ):
        run(client, CountedComputation(tmp_path), lines=lines)
    assert lines == ["waiting for the workers to start"]


def test_workers_that_see_another_store_compute_nothing(tmp_path):
    root = tmp_path / "s.s2r"
    stage = stage_of("x")
    plan = plan_of(root, stage)
    plan_of(tmp_path / "other.s2r", stage)
    with edit(tmp_path / "other.s2r") as draft:
        draft.update("dataset", {"hash": "0" * 64}, {"hash": "2" * 64})
    tasks = [Task(CountedComputation(root), unit) for unit in plan.units]
    with cluster(1) as (_, client):
        for folder, reason in (("missing.s2r", "no such folder"), ("other.s2r", "another store")):
            executor = DaskExecutor(client, print, worker_root=tmp_path / folder)
            with pytest.raises(RequestError, match=rf"no worker can compute .*{reason}"):
                list(executor.run(tasks))


def test_a_lost_scheduler_is_told_and_the_rerun_computes_the_rest(tmp_path):
    def lose(count: int) -> None:
        if count == 4:
            started.sync(started.scheduler.close)

    with (
        cluster(1) as (started, client),
        pytest.raises(RequestError, match=r"connection to the scheduler was lost; .* units"),
    ):
        run(client, CountedComputation(tmp_path, 0.01), on_receipt=lose)
    left = len(plan_of(tmp_path, stage_of("x")).units)
    assert 0 < left <= 11
    counted_units.started.clear()
    with cluster(1) as (_, client):
        run(client, CountedComputation(tmp_path))
    assert len(counted_units.started) == left


def test_leaving_the_iterator_cancels_what_is_assigned(tmp_path):
    """The second unit is computed until the scheduler and the worker have dropped the others."""
    is_left = threading.Event()
    counted_units.on_start[1] = lambda: is_left.wait(30)
    plan = plan_of(tmp_path, stage_of("x"))
    assert len(plan.units) > 1 + dask_executor.IN_FLIGHT
    tasks = [Task(CountedComputation(tmp_path), unit) for unit in plan.units]
    with cluster(1) as (started, client):
        for _ in DaskExecutor(client, print).run(tasks):
            break
        worker = next(iter(started.workers.values()))
        is_dropped = wait_until(
            lambda: not started.scheduler.tasks and len(worker.state.tasks) <= 1
        )
        is_left.set()
        assert is_dropped
    assert set(counted_units.started) <= {0, 1}


class _Facts:
    """Lets the second worker that is asked for its facts tell them only when `is_wanted`."""

    asked = 0
    is_second_asked = threading.Event()
    is_wanted = threading.Event()


_DESCRIBE = dask_worker.describe


def test_the_last_job_that_is_refused_is_told(tmp_path):
    """Its cluster has submitted two jobs again, and SLURM has refused both."""
    plan = plan_of(tmp_path, stage_of("x"))
    tasks = [Task(CountedComputation(tmp_path), unit) for unit in plan.units]
    refused = {"1": "sbatch: error: Invalid account", "2": "sbatch: error: QOSMaxJobs"}
    expected = RequestedWorkers(2, refused)
    lines: list[str] = []
    with (
        cluster() as (_, client),
        pytest.raises(RequestError, match=r"no worker is left: 2 of 2 .*\(sbatch: error: QOSMax"),
    ):
        list(DaskExecutor(client, lines.append, expected).run(tasks))
    assert lines == ["2 of 2 jobs were refused (sbatch: error: QOSMaxJobs)"]


def test_workers_of_this_machine_keep_the_threads_of_a_begun_array(tmp_path):
    """The cluster starts processes, which import the modules that this process finds."""
    stages = [stage_of(name) for name in ("x", "y")]
    plan = plan_of(tmp_path, *stages)
    assert plan.units[0].stage.name == "x"
    plan.finish(CountedComputation(tmp_path).open(2)(plan.units[0]))
    plan = plan_of(tmp_path, *stages)
    with open_cluster("local:1", None, None, print) as executor:
        tasks = [
            Task(CountedComputation(tmp_path), u, plan.environment(u, "numpy")) for u in plan.units
        ]
        for receipt in executor.run(tasks):
            plan.finish(receipt, is_checked=True)
        plan.close()
    assert_complete(tmp_path, *stages)
    threads: dict[str, set[int]] = {}
    for path, entries in Ledger(tmp_path).by_path().items():
        if path.startswith("runs.zarr"):
            name = next(s.name for s in stages if s.specs[0].key in path)
            threads.setdefault(name, set()).update(e.environment.threads for e in entries)
    assert threads == {"x": {2}, "y": {default_threads(1)}}


def test_a_worker_that_connects_after_an_append_sees_the_same_store(tmp_path):
    root = tmp_path / "s.s2r"
    plan_of(root, stage_of("x"))
    with s2rstore.open(root) as store:
        identity, (part,) = store.identity, store.parts
    with edit(root) as draft:  # as an append that ends while another process plans
        for number, sha256 in enumerate((part.hash, "3" * 64)):
            row = {"part": number, "first_iid": 2 * number, "instances": 2, "hash": sha256}
            draft.insert_row("part", row)
        draft.update("dataset", {"hash": part.hash}, {"hash": "4" * 64})
    for hashes, problem in (((part.hash, identity), ""), (("4" * 64, ""), ""),
                            ((part.hash, "5" * 64), f"{root} is another store there")):  # fmt: skip
        assert dask_worker.describe(root, StoreIdentity(*hashes)).problem == problem
