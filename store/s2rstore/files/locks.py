"""Locks between the processes, also of several hosts, that write one store.

`publish` is held for the seconds that a new generation takes; `compute` for as long as a process
fills `runs.zarr`. A file that is replaced as a whole has a separate lock. Readers take none. The
locks are leases (`s2rstore.files.lease`): call `check` of the lease directly before a step that
readers see.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files import layout, lease
from s2rstore.files.lease import COMPUTE_TIMING, TIMING, Lease, ReportLine, Timing
from s2rstore.files.lock_file import LockFile


def publish_lock(
    root: Path, timeout: float = 120.0, timing: Timing = TIMING
) -> AbstractContextManager[Lease]:
    """Wait up to `timeout` seconds for other publishers; StoreBusyError after that."""
    return _held(_store_file(root, "publish"), f"{root}: the publish lock", timeout, timing)


def compute_lock(
    root: Path,
    timeout: float = 0.0,
    report_line: ReportLine = lambda line: None,
    timing: Timing = COMPUTE_TIMING,
) -> AbstractContextManager[Lease]:
    """Hold the compute lock; StoreBusyError names the process that holds it already.

    A holder without a recent heartbeat is observed for the limit of `timing`; `report_line` gets a
    line that says so.
    """
    file, what = _store_file(root, "compute"), f"{root}: the compute lock"
    return _held(file, what, timeout, timing, observe=True, report_line=report_line)


def file_lock(
    path: Path, timeout: float = 120.0, timing: Timing = TIMING
) -> AbstractContextManager[Lease]:
    """Wait up to `timeout` seconds for other writers of this file; StoreBusyError after that."""
    with suppress(OSError):
        path.parent.mkdir(exist_ok=True)
    lock = LockFile(path.with_name(f".{path.name}.lock"))
    return _held(lock, f"{path}: the writing lock", timeout, timing)


def _store_file(root: Path, name: str) -> LockFile:
    return LockFile(root / layout.LEDGER / f"{name}.lock", root)


@contextmanager
def _held(
    file: LockFile,
    what: str,
    timeout: float,
    timing: Timing,
    observe: bool = False,
    report_line: ReportLine = lambda line: None,
) -> Iterator[Lease]:
    held = lease.acquire(file, what, timeout, timing, observe, report_line)
    try:
        yield held
    except BaseException:
        with suppress(RequestError):  # the first error is the one to report
            held.release()
        raise
    held.release()
