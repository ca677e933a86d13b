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
    from s2rtools.precompute.unit_computer import Machine
    from s2rtools.precompute.unit_results import Receipt


@dataclass(frozen=True, slots=True)
class WorkerFacts:
    """A worker's host, machine and release of this program.

    `problem` says why it cannot compute units of the store; empty where it can.
    """

    host: str
    machine: Machine
    release: str
    problem: str


@dataclass(frozen=True, slots=True)
class StoreIdentity:
    """The hash of all data of a store, and that of its first part, which an append does not change.

    The first is read without opening the index, which another host may see late.
    """

    dataset_hash: str
    identity: str


def describe(root: Path, identity: StoreIdentity) -> WorkerFacts:
    """The facts of this worker, which shall compute units of the store at `root`."""
    return _computing_thread().submit(_describe, root, identity).result()


def _describe(root: Path, identity: StoreIdentity) -> WorkerFacts:
    from s2rtools.precompute.unit_computer import this_machine

    problem = _problem(root, identity)
    return WorkerFacts(socket.gethostname(), this_machine(), metadata.version("s2rtui"), problem)


def _problem(root: Path, identity: StoreIdentity) -> str:
    import s2rstore
    from s2rstore.errors import S2RError
    from s2rstore.files import layout

    try:
        if layout.read_current(root).dataset_hash == identity.dataset_hash:
            return ""
        with s2rstore.open(root) as store:  # instances may have been appended
            same = store.identity == identity.identity
    except S2RError as error:
        return f"{error} (mount the folder of the store there)"
    return "" if same else f"{root} is another store there"


def compute_here(task: Task) -> Receipt:
    """Compute a task with the threads that this worker was given.

    One thread computes all tasks of a worker, one after the other, because libraries keep their
    number of threads per thread. Errors of the store or the request name the worker.
    """
    from distributed import get_worker

    from s2rstore.errors import RequestError, S2RError

    worker = get_worker()
    try:
        return _computing_thread().submit(_compute, task, worker.state.nthreads).result()
    except (S2RError, OSError) as error:
        where = f"{worker.address.rpartition('/')[2]} on {socket.gethostname()}"
        raise RequestError(f"{error} (worker {where})") from error


def _compute(task: Task, threads: int) -> Receipt:
    from s2rtools.precompute.executors.executor import compute

    return compute(task, threads)


@cache
def _computing_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "compute")
