"""What runs in the worker processes of a Dask cluster.

Dask imports this module in the thread that also answers the scheduler, so that it imports nothing
that takes seconds.
"""

from __future__ import annotations

import socket
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from s2rtools.precompute.executors.executor import Task
    from s2rtools.precompute.machine import Machine
    from s2rtools.precompute.receipts import Receipt


@dataclass(frozen=True, slots=True)
class WorkerFacts:
    """A worker's host, machine and release of this program.

    `problem` says why it cannot compute units of the store; empty where it can.
    """

    host: str
    machine: Machine
    release: str
    problem: str


def describe(root: Path, identity: str) -> WorkerFacts:
    """The facts of this worker, which shall compute units of the store at `root`.

    `identity` is that of the store, which stays the same when instances are appended meanwhile.
    """
    return _computing_thread().submit(_describe, root, identity).result()


def _describe(root: Path, identity: str) -> WorkerFacts:
    from s2rtools.precompute.machine import this_machine

    problem = _problem(root, identity)
    return WorkerFacts(socket.gethostname(), this_machine(), metadata.version("s2rtui"), problem)


def _problem(root: Path, identity: str) -> str:
    import s2rstore
    from s2rstore.errors import S2RError

    try:
        with s2rstore.open(root) as store:
            same = store.identity == identity
    except S2RError as error:
        return f"{error} (mount the folder of the store there)"
    return "" if same else f"{root} is another store there"


def compute_here(task: Task) -> Receipt:
    """Compute a task with the threads that this worker was given.

    One thread computes all tasks of a worker, one after the other, because libraries keep their
    number of threads per thread.
    """
    from distributed import get_worker

    threads = get_worker().state.nthreads
    return _computing_thread().submit(_compute, task, threads).result()


def _compute(task: Task, threads: int) -> Receipt:
    from s2rtools.precompute.executors.executor import compute

    return compute(task, threads)


@cache
def _computing_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "compute")
