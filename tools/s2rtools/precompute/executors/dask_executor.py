"""Executor of a Dask cluster.

Dask distributes the tasks; this process tells it which workers may compute them. It reads the list
of workers twice a second: new ones are asked which machine they run on, and the arrays of a stage
are computed by those of one environment. Tasks are submitted a few at a time, so that workers that
connect later get some, too.
"""

from __future__ import annotations

import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

from distributed import Client, Future, KilledWorker, as_completed
from distributed.comm import CommClosedError

from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rtools.precompute import unit_results
from s2rtools.precompute.executors import dask_worker
from s2rtools.precompute.executors.dask_worker import StoreIdentity, WorkerFacts
from s2rtools.precompute.executors.executor import RequestedWorkers, Task
from s2rtools.precompute.unit_results import Receipt
from s2rtools.precompute.work_units import WorkUnit

IN_FLIGHT = 2
"""Submitted tasks for each worker: the one that it computes, and the next one."""
MOST_LOSSES = 3
"""A unit with which workers were lost this often is not computed again."""
NO_WORKERS_SECONDS = 60.0
"""How long a scheduler without workers is waited for, where none are known to be on their way."""
_FACTS_SECONDS = 30.0
_ENDED = ("closing", "closed", "failed")
"""Names of `distributed.Status`."""
_THREADS_HOW = " (`--threads` of local:N, `cores` of SLURM settings, `dask worker --nthreads`)"
_POLL_SECONDS = 0.5
_LONGEST_PAUSE = 0.02


@dataclass(eq=False)
class _Worker:
    """A connected worker; `facts` are None until it has told them, `since` is when it was asked.

    `problem` says why it computes nothing.
    """

    address: str
    threads: int
    since: float
    facts: WorkerFacts | None = None
    problem: str = ""

    def __str__(self) -> str:
        where = self.address.rpartition("/")[2]
        return where if self.facts is None else f"{where} on {self.facts.host}"

    @property
    def is_usable(self) -> bool:
        return self.facts is not None and not self.problem

    @property
    def is_silent(self) -> bool:
        """Whether it has not told its facts."""
        return self.facts is None and not self.problem

    @property
    def is_asked(self) -> bool:
        """Whether it may still tell its facts soon."""
        return self.is_silent and time.monotonic() < self.since + _FACTS_SECONDS

    def environment(self, task: Task) -> ComputeEnvironment:
        """The environment in which this worker would compute a task."""
        assert self.facts is not None
        return task.computation.environment(task.unit.stage, self.facts.machine, self.threads)


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
        self._workers: dict[str, _Worker] = {}

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
        workers: dict[str, _Worker],
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
        self._losses: Counter[str] = Counter()
        self._suspects: deque[Task] = deque()
        self._failed: list[WorkUnit] = []
        self._futures: dict[str, Future] = {}
        self._asked: dict[str, _Worker] = {}
        self._submitted: dict[str, tuple[Task, frozenset[str]]] = {}
        self._finished = as_completed(loop=client.loop, with_results=True, raise_errors=False)
        self._waiting_since: float | None = None

    def receipts(self) -> Iterator[Receipt]:
        """The receipts of all tasks but those that fail."""
        next_poll = pause = 0.0
        while self._left:
            if time.monotonic() >= next_poll:
                self._poll()
                next_poll = time.monotonic() + _POLL_SECONDS
            self._submit_tasks()
            batch = self._finished.next_batch(block=False)
            for future, result in batch:
                receipt = self._completed(future, result)
                if receipt is not None:
                    yield receipt
            pause = 0.0 if batch else min(2 * pause + 0.001, _LONGEST_PAUSE)
            time.sleep(pause)

    def cancel(self) -> None:
        """Cancel what is submitted; a unit that a worker computes at present is not used.

        Workers that have not told their facts are forgotten, so that the next run asks them again.
        """
        futures = list(self._futures.values())
        self._futures.clear()
        for worker in [worker for worker in self._workers.values() if worker.is_silent]:
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
                f"{self._root}: workers were lost repeatedly while they computed "
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
            self._report_line(f"worker {self._workers.pop(address)} was lost")
        for key, (_, addresses) in [*self._submitted.items()]:
            if addresses.isdisjoint(connected):  # Dask would wait for one of them
                self._client.cancel([self._futures.pop(key)], force=True)
                self._suspect(self._submitted.pop(key)[0])
        for address in [each for each in connected if each not in self._workers]:
            threads = int(connected[address]["nthreads"])
            worker = self._workers[address] = _Worker(address, threads, time.monotonic())
            facts = (self._worker_root, self._identity)
            (key,) = self._submit([address], dask_worker.describe, *([each] for each in facts))
            self._asked[key] = worker
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
        for task in [*(queue[0] for queue in self._queues.values() if queue), *self._suspects]:
            refusals = [self._refusal(worker, task) for worker in workers if worker.is_usable]
            if all(refusals):
                stage, reason = task.unit.stage, refusals[0]
                how = _THREADS_HOW if reason.startswith("threads ") else ""
                raise RequestError(
                    f"{self._root}: no worker may compute {stage.run}: {stage.name}: {reason}, "
                    "with which its arrays were begun; all values of an array come from one kind "
                    f"of worker: go on with that kind{how}, or add --restart to begin these arrays "
                    "again"
                )

    def _submit_tasks(self) -> None:
        """Submit tasks for the workers that may compute them, `IN_FLIGHT` for each.

        Those with which a worker was lost are computed alone, after all others: else one that
        waited in the worker would be taken for the cause.
        """
        if any(worker.is_asked for worker in self._workers.values()) and not self._received:
            return  # which kind of worker is the most common one is not known
        for queue in self._queues.values():
            if queue and (able := self._able(queue[0])):
                submitted = sum(not able.isdisjoint(each) for _, each in self._submitted.values())
                count = min(len(queue), IN_FLIGHT * len(able) - submitted)
                if count > 0:
                    self._map([queue.popleft() for _ in range(count)], able)
        if self._suspects and not self._submitted and (able := self._able(self._suspects[0])):
            self._map([self._suspects.popleft()], able)

    def _map(self, tasks: Sequence[Task], able: frozenset[str]) -> None:
        sent = [
            replace(task, computation=replace(
                task.computation, root=self._worker_root, durable=True
            ))
            for task in tasks
        ]  # fmt: skip
        keys = self._submit(sorted(able), dask_worker.compute_here, sent)
        self._submitted |= {key: (task, able) for key, task in zip(keys, tasks, strict=True)}

    def _able(self, task: Task) -> frozenset[str]:
        """The addresses of the workers that may compute the arrays of a task's stage."""
        workers = [worker for worker in self._workers.values() if worker.is_usable]
        return frozenset(worker.address for worker in workers if not self._refusal(worker, task))

    def _refusal(self, worker: _Worker, task: Task) -> str:
        """Why a worker may not compute the arrays of a task's stage; empty where it may."""
        folder = unit_results.folder(task.unit.stage)
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
        self, addresses: list[str], function: Callable[..., Any], *arguments: list[Any]
    ) -> list[str]:
        """Let workers call a function for each place of lists of arguments; keys of the futures."""
        keys = [f"s2r-{uuid.uuid4().hex}" for _ in arguments[0]]
        for future in self._client.map(
            function, *arguments, key=keys, pure=False, workers=addresses, fifo_timeout="0 ms"
        ):
            self._futures[str(future.key)] = future
            self._finished.add(future)
        return keys

    def _completed(self, future: Future, result: Any) -> Receipt | None:
        """The receipt of a computed task; None for other results.

        Raises the error that a task has raised, RequestError for the loss of the scheduler.
        """
        if self._client.status != "running":
            raise self.lost_scheduler()
        if self._futures.pop(future.key, None) is None:  # it is cancelled
            return None
        if (worker := self._asked.pop(future.key, None)) is not None:
            self._learn(worker, result if future.status == "finished" else _error_text(result))
            return None
        task, _ = self._submitted.pop(future.key)
        if future.status == "finished":
            assert isinstance(result, Receipt)
            self._left -= 1
            self._received += 1
            return result
        if future.status == "error" and not isinstance(result[1], KilledWorker | CommClosedError):
            raise result[1]
        self._suspect(task)
        return None

    def _learn(self, worker: _Worker, facts: WorkerFacts | str) -> None:
        """Note the facts of a worker, or the error that it has told in their place."""
        here = metadata.version("s2rtui")
        if isinstance(facts, str):
            worker.problem = f"cannot load s2rtools {here} ({facts})"
        else:
            worker.facts, worker.problem = facts, facts.problem
            if facts.release != here:
                worker.problem = f"has s2rtui {facts.release}, not {here}"
        if worker.problem:
            self._report_line(f"worker {worker} computes nothing: {worker.problem}")

    def _suspect(self, task: Task) -> None:
        """Compute a task again with which a worker was lost, unless too many were."""
        name = unit_results.file_name(task.unit.stage, task.unit.number)
        self._losses[name] += 1
        if self._losses[name] < MOST_LOSSES:
            self._suspects.append(task)
        else:
            self._failed.append(task.unit)
            self._left -= 1


def _error_text(result: Any) -> str:
    """The error of a future, in one line."""
    error = result[1] if isinstance(result, tuple) else result
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {lines[-1]}" if lines else type(error).__name__
