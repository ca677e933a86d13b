"""Executors of this machine: this process, or worker processes that end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from typing import Self

from threadpoolctl import threadpool_limits

from s2rstore.errors import RequestError
from s2rstore.security import working_folder
from s2rtools.common.parent_process import end_with_parent
from s2rtools.common.processors import available_memory, available_processors
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.inference.cuda_backend import CudaBackend
from s2rtools.precompute.executors.executor import Task, by_threads, close, compute
from s2rtools.precompute.unit_results import Receipt

_PASSES_PER_WORKER = 256
"""Instances with one pass from which a further worker, which starts for some seconds, pays off."""
_PASSES = {"forward": 1, "tens": 6, "hundreds": 12}
"""Instances with one pass that take as long as one with a heatmap kind of each cost."""
_WORKER_BYTES = 2 * 2**30


def default_workers(passes: int) -> int:
    """How many processes compute the units of instances with so many passes the fastest.

    One thread in each of several processes computes networks faster than several threads in one
    process. Limited by the processors, and by the available memory at 2 GB a process.
    """
    memory = available_memory()
    limits = [available_processors(), passes // _PASSES_PER_WORKER]
    if memory is not None:
        limits.append(memory // _WORKER_BYTES)
    return max(1, min(limits))


def default_threads(workers: int) -> int:
    """How many threads each of some processes of this machine computes with."""
    return max(1, available_processors() // workers)


class WorkerPool:
    """Worker processes of this machine, kept for later tasks until `close`.

    `report_line` is told when ctrl+c waits for the tasks in progress.
    """

    def __init__(self, report_line: Callable[[str], None] = lambda line: None) -> None:
        self.report_line = report_line
        self._pool: ProcessPoolExecutor | None = None
        self._workers = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def start(self, workers: int) -> None:
        """Let processes import what they need, while this one does something else."""
        try:
            self._import(self.processes(workers), workers)
        except BrokenProcessPool:  # a process was killed since the last run
            self.close()
            self._import(self.processes(workers), workers)

    @staticmethod
    def _import(processes: ProcessPoolExecutor, workers: int) -> None:
        with defer_interrupts():
            for _ in range(workers):
                processes.submit(close)  # has nothing to close yet, but is imported with `compute`

    def processes(self, workers: int) -> ProcessPoolExecutor:
        """At least so many processes, which start when they are given tasks."""
        if self._pool is None or self._workers < workers:
            self.close()
            working_folder.distrust()
            start_resource_tracker()
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(
                workers, context, end_with_parent, (signal.SIGKILL, os.getpid())
            )
            self._workers = workers
        return self._pool

    def close(self) -> None:
        """End the processes after the tasks that they compute; others are not begun."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool, self._workers = None, 0

    def interrupt(self) -> None:
        """As `close`, and say so; ctrl+c meanwhile ends the processes at once."""
        handler = signal.getsignal(signal.SIGINT)
        with suppress(ValueError):  # not the main thread, which alone is interrupted
            signal.signal(signal.SIGINT, _kill_children)
        try:
            self.report_line(
                "waiting for the work units in progress; press ctrl+c again to drop them"
            )
            self.close()
        finally:
            with suppress(ValueError):
                signal.signal(signal.SIGINT, handler)


def _kill_children(*_: object) -> None:
    """A signal handler that lets the pool end in order, as after a worker that was killed."""
    for process in multiprocessing.active_children():
        process.kill()


class SerialExecutor:
    """Computes tasks one after the other in this process."""

    is_remote = False

    def __init__(self, threads: int) -> None:
        self._threads = threads

    def run(self, tasks: Iterable[Task]) -> Iterator[Receipt]:
        with threadpool_limits(self._threads):  # restores the limits that opening a worker sets
            try:
                for task in tasks:
                    yield compute(task, self._threads)
            finally:
                close()


class ProcessExecutor:
    """Computes tasks in processes of this machine, which end with this one.

    They belong to `pool`, or, without one, to one call of `run`, which raises RequestError if a
    worker process is killed.
    """

    is_remote = False

    def __init__(self, workers: int, threads: int, pool: WorkerPool | None = None) -> None:
        self._workers, self._threads = workers, threads
        self._pool, self._is_kept = pool or WorkerPool(), pool is not None

    def run(self, tasks: Iterable[Task]) -> Iterator[Receipt]:
        tasks, is_complete = list(tasks), False
        processes = self._pool.processes(self._workers)
        try:
            with defer_interrupts():
                futures = [processes.submit(compute, task, self._threads) for task in tasks]
            for future in as_completed(futures):
                yield future.result()
            is_complete = True
        except KeyboardInterrupt:
            self._pool.interrupt()
            raise
        except BrokenProcessPool as error:
            raise RequestError(
                f"{tasks[0].computation.root}: a worker process was killed (out of memory?); "
                "finished units are stored; run the command again, with --workers 1 if memory "
                "is short"
            ) from error
        finally:
            if not (is_complete and self._is_kept):
                self._pool.close()


class LocalExecutor:
    """Computes tasks in as many processes of this machine as pay off, or in this one alone.

    `workers` and `threads` are those that are requested, of `PrecomputeOptions`. The processes
    belong to `pool`.
    """

    is_remote = False

    def __init__(self, pool: WorkerPool, workers: int | None, threads: int | None) -> None:
        self._pool, self._workers, self._threads = pool, workers, threads

    def start(self, instances: int) -> None:
        """Start the processes that will compute some new instances, while this one goes on."""
        workers = min(self._workers or available_processors(), default_workers(instances))
        if workers > 1 and CudaBackend.unavailable_reason() is not None:
            self._pool.start(workers)

    def threads(self, instances: int) -> int:
        """The threads with which each process computes some instances."""
        return self._threads or default_threads(self._workers or default_workers(instances))

    def run(self, tasks: Iterable[Task]) -> Iterator[Receipt]:
        tasks = list(tasks)
        workers = self._workers or default_workers(_passes(tasks))
        workers = min(workers, len(tasks), available_processors())
        if any(task.computation.uses_gpu(task.unit.stage) for task in tasks):
            workers = 1
        groups = by_threads(tasks, self._threads, default_threads(workers))
        for threads, some in groups.items():
            if workers == 1:
                yield from SerialExecutor(threads).run(some)
            else:
                yield from ProcessExecutor(workers, threads, self._pool).run(some)


def _passes(tasks: Iterable[Task]) -> int:
    """Instances of tasks, each as often as the kinds of every cost among its arrays take passes."""
    return sum(
        len(task.unit.instances) * sum({_cost(spec.kind) for spec in task.unit.missing})
        for task in tasks
    )


def _cost(kind: str) -> int:
    return _PASSES[HEATMAP_KINDS[kind].cost] if kind in HEATMAP_KINDS else 1


def start_resource_tracker() -> None:
    """Start multiprocessing's resource tracker with its warnings disabled.

    The tracker removes the semaphores of killed workers; its warning would only follow the error
    that names the reason.
    """
    before = os.environ.get("PYTHONWARNINGS")
    quiet = "ignore:resource_tracker:UserWarning"
    os.environ["PYTHONWARNINGS"] = quiet if before is None else f"{before},{quiet}"
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Defer ctrl+c until the workers have started; workers ignore it from the start."""
    received: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        with suppress(ValueError):  # not the main thread, which alone is interrupted
            signal.signal(signal.SIGINT, lambda number, frame: received.append(number))
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        with suppress(ValueError):
            signal.signal(signal.SIGINT, handler)
    if received:
        raise KeyboardInterrupt
