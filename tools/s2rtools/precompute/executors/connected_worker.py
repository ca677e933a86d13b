"""A connected worker of a Dask cluster, and what the errors of its tasks mean."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from distributed import KilledWorker
from distributed.comm import CommClosedError

from s2rstore.errors import RequestError, S2RError
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rtools.precompute.executors.dask_worker import WorkerFacts
from s2rtools.precompute.executors.executor import Task

_FACTS_SECONDS = 30.0


@dataclass(eq=False)
class ConnectedWorker:
    """A connected worker; `facts` are None until it has told them, `since` is when it was asked.

    `assigned` are its tasks by the keys of their futures, the one that it computes first. `problem`
    says why it computes nothing. One that is about to end, as at the end of its wall time, does not
    accept tasks.
    """

    address: str
    threads: int
    since: float
    facts: WorkerFacts | None = None
    problem: str = ""
    accepts: bool = True
    assigned: dict[str, Task] = field(default_factory=dict)

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


def error_text(result: Any) -> str:
    """The error of a future, in one line."""
    error = result[1] if isinstance(result, tuple) else result
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {lines[-1]}" if lines else type(error).__name__


def is_loss(error: BaseException) -> bool:
    """Whether an error means that a worker was lost, which the next poll notices."""
    return isinstance(error, KilledWorker | CommClosedError)


def error_of(error: BaseException, worker: ConnectedWorker) -> BaseException:
    """An error of the store or the request names the worker; others are faults of the program."""
    if isinstance(error, S2RError | OSError):
        return RequestError(f"{error} (worker {worker})")
    return error
