"""Executor of a Dask cluster.

This process assigns every task to a worker, a few at a time, so that it knows which one a lost
worker was computing. It reads the list of workers twice a second: tasks of those that are gone are
assigned again, and new ones are asked which machine they run on.
"""

from __future__ import annotations

import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from distributed import Client, Future, as_completed

from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rtools.precompute import unit_results
from s2rtools.precompute.executors import dask_worker
from s2rtools.precompute.executors.connected_worker import (
    ConnectedWorker,
    error_of,
    error_text,
    is_loss,
)
from s2rtools.precompute.executors.dask_worker import StoreIdentity, WorkerFacts
from s2rtools.precompute.executors.executor import Task
from s2rtools.precompute.executors.requested_workers import RequestedWorkers
from s2rtools.precompute.receipts import Receipt
from s2rtools.precompute.work_units import WorkUnit

IN_FLIGHT = 4
"""The most tasks that a worker has at once: the one that it computes, and the next ones."""
_AHEAD_SECONDS = 0.4
"""Work that a worker has at least, so that it does not wait for this process between two tasks.

Longer tasks are assigned one at a time: one that waited in a slow worker while others have nothing
left to do would only delay the end.
"""
MOST_DEATHS = 4
"""A unit during which this many workers were lost is not computed again."""
NO_WORKERS_SECONDS = 60.0
"""How long a scheduler without workers is waited for, where none are known to be on their way."""
_RUNNING, _ENDED = "running", ("closing", "closed", "failed")
"""Names of `distributed.Status`."""
_THREADS_HOW = " (`--threads` of local:N, `cores` of SLURM settings, `dask worker --nthreads`)"
_POLL_SECONDS = 0.5
_LONGEST_PAUSE = 0.02


class DaskExecutor:
    """Computes tasks in the workers of a Dask cluster.

    `expected` are the workers that were requested, None where nobody knows. `worker_root` is the
    folder of the store on the workers, by default the same as here.
    """

    is_remote = True

    def __init__(
        self,
        client: Client,
        report_line: Callable[[str], None],
        expected: RequestedWorkers | None = None,
        worker_root: Path | None = None,
    ) -> None:
        self._client, self._report_line = client, report_line
        self._expected, self._worker_root = expected, worker_root
        self._workers: dict[str, ConnectedWorker] = {}

    def run(self, tasks: Iterable[Task]) -> Iterator[Receipt]:
        """See `Executor`. Raises RequestError for a lost scheduler, for workers that cannot compute
        the tasks, and after all other tasks for those during which workers were lost repeatedly.
        """
        tasks = list(tasks)
        if not tasks:
            return
        root = self._worker_root or tasks[0].computation.root.resolve()
        dispatch = _Dispatch(
            self._client, tasks, self._workers, self._report_line, self._expected, root
        )
        try:
            yield from dispatch.receipts()
        except (OSError, TimeoutError) as error:  # of the connection; those of units are others
            raise dispatch.lost_scheduler() from error
        finally:
            dispatch.cancel()
        dispatch.raise_failures()


class _Dispatch:
    """The state of one `run`: tasks by the folder of their stage's results, and the workers."""

    def __init__(
        self,
        client: Client,
        tasks: Sequence[Task],
        workers: dict[str, ConnectedWorker],
        report_line: Callable[[str], None],
        expected: RequestedWorkers | None,
        worker_root: Path,
    ) -> None:
        self._client, self._workers = client, workers
        self._report_line, self._expected = report_line, expected
        self._root, self._worker_root = tasks[0].computation.root, worker_root
        dataset_hash = layout.read_current(self._root).dataset_hash
        self._identity = StoreIdentity(dataset_hash, tasks[0].computation.identity)
        self._queues: dict[str, deque[Task]] = {}
        self._environments: dict[str, ComputeEnvironment] = {}
        for task in tasks:
            folder = unit_results.folder(task.unit.stage)
            self._queues.setdefault(folder, deque()).append(task)
            if task.environment is not None:
                self._environments[folder] = task.environment
        self._left, self._received = len(tasks), 0
        self._refused: dict[tuple[str, str], str] = {}
        self._seconds: dict[str, float] = {}
        self._deaths: Counter[str] = Counter()
        self._suspects: set[str] = set()
        self._failed: list[WorkUnit] = []
        self._futures: dict[str, tuple[Future, ConnectedWorker]] = {}
        self._finished = as_completed(loop=client.loop, with_results=True, raise_errors=False)
        self._waiting_since: float | None = None

    def receipts(self) -> Iterator[Receipt]:
        """The receipts of all tasks but those that fail."""
        next_poll = pause = 0.0
        while self._left:
            if time.monotonic() >= next_poll:
                self._poll()
                next_poll = time.monotonic() + _POLL_SECONDS
            self._assign()
            batch = self._finished.next_batch(block=False)
            for future, result in batch:
                receipt = self._completed(future, result)
                if receipt is not None:
                    yield receipt
            pause = 0.0 if batch else min(2 * pause + 0.001, _LONGEST_PAUSE)
            time.sleep(pause)

    def cancel(self) -> None:
        """Cancel what is assigned; a unit that a worker computes at present is not used.

        Workers that have not told their facts are forgotten, so that the next run asks them again.
        """
        futures = [future for future, _ in self._futures.values()]
        self._futures.clear()
        for worker in [*self._workers.values()]:
            worker.assigned.clear()
            if worker.is_silent:
                del self._workers[worker.address]
        if futures and self._client.status == "running":
            with suppress(OSError, TimeoutError):
                self._client.cancel(futures, force=True)

    def raise_failures(self) -> None:
        if self._failed:
            unit = self._failed[0]
            rows = unit.instances
            more = f" and {len(self._failed) - 1} other units" if self._failed[1:] else ""
            raise RequestError(
                f"{self._root}: {MOST_DEATHS} workers were lost while they computed "
                f"{unit.stage.run}: {unit.stage.name}, instances {rows.start} to {rows.stop - 1}"
                f"{more} (out of memory?); all other units of this step are stored; run the "
                "command again, with more memory for each worker"
            )

    def lost_scheduler(self) -> RequestError:
        return RequestError(
            f"{self._root}: the connection to the scheduler was lost; {self._received} units of "
            f"this step are stored, {self._left} are left; run the command again when there is a "
            "scheduler"
        )

    def _poll(self) -> None:
        """Notice workers that have come or gone."""
        if self._client.status != "running":
            raise self.lost_scheduler()
        connected = self._connected()
        for address in [each for each in self._workers if each not in connected]:
            self._lose(self._workers.pop(address))
        for address in [each for each in connected if each not in self._workers]:
            threads = int(connected[address]["nthreads"])
            worker = self._workers[address] = ConnectedWorker(address, threads, time.monotonic())
            self._submit(worker, dask_worker.describe, self._worker_root, self._identity)
        for address, worker in self._workers.items():
            worker.accepts = connected[address]["status"] == _RUNNING
        if self._expected is not None and (line := self._expected.news()):
            self._report_line(line)
        self._check_workers()

    def _connected(self) -> dict[str, Any]:
        """The scheduler's records of the connected workers, by address.

        Not by `Client.scheduler_info`, from which another thread may remove the workers.
        """
        identity = self._client.sync(self._client.scheduler.identity, n_workers=-1)
        workers: dict[str, Any] = identity["workers"]
        return {a: record for a, record in workers.items() if record["status"] not in _ENDED}

    def _check_workers(self) -> None:
        """Report that no worker is ready yet. Raises RequestError where none can come."""
        workers = self._workers.values()
        if any(worker.is_usable or worker.is_asked for worker in workers):
            self._waiting_since = None
            self._check_refusals()
            return
        problems = [f"{worker}: {worker.problem}" for worker in workers if worker.problem]
        arriving = None if self._expected is None else self._expected.arriving
        if problems and len(workers) >= (arriving or 1):
            raise RequestError(f"{self._root}: no worker can compute ({problems[0]})")
        if self._expected is not None and not arriving:
            raise RequestError(f"{self._root}: no worker is left: {self._expected.refusal}")
        if self._waiting_since is None:
            self._waiting_since = time.monotonic()
            self._report_line(f"waiting for {arriving or 'the'} workers to start")
        elif self._expected is None and (
            time.monotonic() > self._waiting_since + NO_WORKERS_SECONDS
        ):
            raise RequestError(
                f"{self._client.scheduler.address}: the scheduler has no workers; start some with "
                "`dask worker`"
            )

    def _check_refusals(self) -> None:
        """Raise RequestError for tasks that all workers are left out of."""
        workers = self._workers.values()
        arriving = 1 if self._expected is None else self._expected.arriving
        if len(workers) < arriving or any(worker.is_asked for worker in workers):
            return
        for folder, queue in self._queues.items():
            refusals = [self._refused.get((w.address, folder)) for w in workers if w.is_usable]
            if queue and all(refusals):
                stage, reason = queue[0].unit.stage, str(refusals[0])
                how = _THREADS_HOW if reason.startswith("threads ") else ""
                raise RequestError(
                    f"{self._root}: no worker may compute {stage.run}: {stage.name}: {reason}, "
                    "with which its arrays were begun; all values of an array come from one kind "
                    f"of worker: go on with that kind{how}, or add --restart to begin these arrays "
                    "again"
                )

    def _assign(self) -> None:
        """Give tasks to workers that have few; no worker gets its next one before all others."""
        if any(worker.is_asked for worker in self._workers.values()) and not self._received:
            return  # which kind of worker is the most common one is not known
        for count in range(IN_FLIGHT):
            for worker in self._workers.values():
                if worker.is_usable and worker.accepts and len(worker.assigned) <= count:
                    task = self._next_task(worker)
                    if task is not None:
                        computation = replace(
                            task.computation, root=self._worker_root, durable=True
                        )
                        sent = replace(task, computation=computation)
                        key = self._submit(worker, dask_worker.compute_here, sent)
                        worker.assigned[key] = task

    def _next_task(self, worker: ConnectedWorker) -> Task | None:
        """The next task for a worker; units with which a worker was lost are computed alone.

        Else one that was computed, but not received, would be taken for the cause of the loss.
        """
        if any(_name(task) in self._suspects for task in worker.assigned.values()):
            return None
        for folder, queue in self._queues.items():
            if queue and not self._refusal(worker, folder, queue[0]):
                if worker.assigned and _name(queue[0]) in self._suspects:
                    return None
                if worker.assigned and self._has_enough(worker):
                    return None
                return queue.popleft()
        return None

    def _has_enough(self, worker: ConnectedWorker) -> bool:
        """Whether the assigned tasks keep a worker busy for `_AHEAD_SECONDS`.

        Of a stage of which none is computed yet, two do. The latest ones count most, because the
        first one of a worker also loads what all need.
        """
        folders = (unit_results.folder(task.unit.stage) for task in worker.assigned.values())
        expected = (self._seconds.get(folder, _AHEAD_SECONDS / 2) for folder in folders)
        return sum(expected) >= _AHEAD_SECONDS

    def _refusal(self, worker: ConnectedWorker, folder: str, task: Task) -> str:
        """Why a worker may not compute the arrays of a task's stage; empty where it may."""
        known = self._refused.get((worker.address, folder))
        if known is not None:
            return known
        stage = task.unit.stage
        if task.computation.uses_gpu(stage) and not worker.environment(task).device:
            reason = "no GPU that torch can use"
        else:
            if folder not in self._environments:
                self._environments[folder] = self._most_common_environment(task)
            reason = worker.environment(task).difference(self._environments[folder])
        if reason:
            self._report_line(f"worker {worker} is left out of {stage.run}: {stage.name}: {reason}")
        self._refused[worker.address, folder] = reason
        return reason

    def _most_common_environment(self, task: Task) -> ComputeEnvironment:
        found = [worker.environment(task) for worker in self._workers.values() if worker.is_usable]
        able = [each for each in found if each.device]
        return max(able, key=able.count)

    def _submit(
        self, worker: ConnectedWorker, function: Callable[..., Any], *arguments: Any
    ) -> str:
        """Let a worker call a function after all that it was given before; the future's key."""
        future = self._client.submit(
            function, *arguments, key=f"s2r-{uuid.uuid4().hex}", pure=False, fifo_timeout="0 ms",
            workers=[worker.address], allow_other_workers=False,
        )  # fmt: skip
        self._futures[future.key] = future, worker
        self._finished.add(future)
        return str(future.key)

    def _completed(self, future: Future, result: Any) -> Receipt | None:
        """The receipt of a computed task; None for other results.

        Raises the error that a task has raised, RequestError for the loss of the scheduler.
        """
        if self._client.status != "running":
            raise self.lost_scheduler()
        _, worker = self._futures.pop(future.key, (None, None))
        if worker is None:  # it was lost, or all is cancelled
            return None
        task = worker.assigned.pop(future.key, None)
        if future.status == "finished" and task is None:
            self._learn(worker, result)
        elif future.status == "finished":
            self._left -= 1
            self._received += 1
            assert task is not None
            assert isinstance(result, Receipt)
            folder = unit_results.folder(task.unit.stage)
            self._seconds[folder] = (result.seconds + self._seconds.get(folder, result.seconds)) / 2
            return result
        elif task is None:
            self._exclude(worker, f"cannot load s2rtools {_version()} ({error_text(result)})")
        elif future.status == "error" and not is_loss(result[1]):
            raise error_of(result[1], worker)
        else:
            self._queues[unit_results.folder(task.unit.stage)].appendleft(task)
        return None

    def _learn(self, worker: ConnectedWorker, facts: WorkerFacts) -> None:
        worker.facts = facts
        if facts.release != _version():
            self._exclude(worker, f"has s2rtui {facts.release}, not {_version()}")
        elif facts.problem:
            self._exclude(worker, facts.problem)

    def _exclude(self, worker: ConnectedWorker, problem: str) -> None:
        worker.problem = problem
        self._report_line(f"worker {worker} computes nothing: {problem}")

    def _lose(self, worker: ConnectedWorker) -> None:
        """Queue the tasks of a lost worker again, except one that too many were lost with."""
        lost = [future for future, owner in self._futures.values() if owner is worker]
        for future in lost:
            del self._futures[future.key]
        self._client.cancel(lost, force=True)
        tasks = list(worker.assigned.values())
        if tasks:
            name = _name(tasks[0])
            self._suspects |= {_name(task) for task in tasks}
            self._deaths[name] += 1
            if self._deaths[name] >= MOST_DEATHS:
                self._failed.append(tasks[0].unit)
                self._left -= 1
                del tasks[0]
        for task in reversed(tasks):
            self._queues[unit_results.folder(task.unit.stage)].appendleft(task)
        again = f"; {len(tasks)} units go to other workers" if tasks else ""
        self._report_line(f"worker {worker} was lost{again}")


def _name(task: Task) -> str:
    return unit_results.file_name(task.unit.stage, task.unit.number)


def _version() -> str:
    return metadata.version("s2rtui")
