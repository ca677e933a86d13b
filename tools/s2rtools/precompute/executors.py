"""Run work units in this process or in worker processes; one process writes each unit."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.security import working_folder
from s2rtools.common.processors import available_memory, available_processors
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.precompute.work_units import WorkUnit

ComputeUnit = Callable[[WorkUnit], None]
OpenWorker = Callable[[Path, int], ComputeUnit]

_PR_SET_PDEATHSIG = 1
_INSTANCES_PER_WORKER = 256
"""Instances from which a further worker, which starts for some seconds, pays off."""
_WORKER_BYTES = 2 * 2**30
_compute_unit: ComputeUnit | None = None


def usual_workers(instances: int) -> int:
    """How many processes compute the units of some instances the fastest.

    One thread in each of several processes computes networks faster than several threads in one
    process. Limited by the processors, and by the available memory at 2 GB a process.
    """
    memory = available_memory()
    limits = [available_processors(), instances // _INSTANCES_PER_WORKER]
    if memory is not None:
        limits.append(memory // _WORKER_BYTES)
    return max(1, min(limits))


def largest_first(units: Iterable[WorkUnit]) -> list[WorkUnit]:
    """Units in the order in which several processes finish them the earliest."""

    def key(unit: WorkUnit) -> tuple[bool, int]:
        kind = HEATMAP_KINDS.get(unit.stage.name)
        return kind is None or kind.cost != "many", -len(unit.instances)

    return sorted(units, key=key)


def run_units(
    root: Path, units: Iterable[WorkUnit], opener: OpenWorker, workers: int
) -> Iterator[WorkUnit]:
    """Compute units and yield each finished one.

    `opener(root, threads)` is called once in each process and returns the function that computes
    a unit. Raises RequestError if a worker process is killed.
    """
    threads = max(1, available_processors() // workers)
    if workers == 1:
        compute = opener(root, threads)
        for unit in units:
            compute(unit)
            yield unit
        return
    working_folder.distrust()
    context = multiprocessing.get_context("spawn")
    _start_resource_tracker()
    with ProcessPoolExecutor(workers, context, _start_worker, (root, opener, threads)) as pool:
        try:
            with _defer_interrupts():
                futures = {pool.submit(_run_in_worker, unit): unit for unit in units}
            for future in as_completed(futures):
                future.result()
                yield futures[future]
        except BrokenProcessPool as error:
            raise RequestError(
                f"{root}: a worker process was killed (out of memory?); finished units are stored; "
                "run the command again, with --workers 1 if memory is short"
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _start_resource_tracker() -> None:
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
def _defer_interrupts() -> Iterator[None]:
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


def _start_worker(root: Path, opener: OpenWorker, threads: int) -> None:
    """Open this worker; it ends with its parent, so that it cannot write the files of a rerun."""
    global _compute_unit
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() == 1:
            os._exit(1)
    _compute_unit = opener(root, threads)


def _run_in_worker(unit: WorkUnit) -> None:
    assert _compute_unit is not None, "the worker was not started"
    _compute_unit(unit)
