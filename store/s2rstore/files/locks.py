"""Advisory locks between the processes that write one store.

`publish` is held for the seconds that a new generation takes; `compute` for as long as a process
fills `runs.zarr`. A file that is replaced as a whole has a lock of its own. Readers take none.
"""

from __future__ import annotations

import fcntl
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import layout, safe_files


@contextmanager
def publish_lock(root: Path, timeout: float = 120.0) -> Iterator[None]:
    """Wait up to `timeout` seconds for other publishers; StoreBusyError after that."""
    with _locked(root, "publish", timeout):
        yield


@contextmanager
def compute_lock(root: Path, timeout: float = 0.0) -> Iterator[None]:
    """Hold the compute lock; StoreBusyError names the process that holds it already."""
    with _locked(root, "compute", timeout):
        yield


@contextmanager
def file_lock(path: Path, timeout: float = 120.0) -> Iterator[None]:
    """Wait up to `timeout` seconds for other writers of this file; StoreBusyError after that."""
    with suppress(OSError):
        path.parent.mkdir(exist_ok=True)
    lock = path.with_name(f".{path.name}.lock")
    with _held(partial(safe_files.open_lock, lock), path, "writing", timeout):
        yield


@contextmanager
def _locked(root: Path, what: str, timeout: float) -> Iterator[None]:
    lock = f"{layout.LEDGER}/{what}.lock"
    with _held(partial(safe_files.open_store_lock, root, lock), root, what, timeout):
        yield


@contextmanager
def _held(open_lock: Callable[[], int], path: Path, name: str, timeout: float) -> Iterator[None]:
    try:
        descriptor = open_lock()
    except OSError as error:
        raise RequestError(
            f"{path}: the {name} lock cannot be opened ({error.strerror})"
        ) from error
    try:
        _wait(descriptor, path, name, timeout)
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
        yield
    finally:
        os.close(descriptor)


def _wait(descriptor: int, path: Path, name: str, timeout: float) -> None:
    deadline = time.monotonic() + timeout
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() >= deadline:
                holder = os.pread(descriptor, 200, 0).decode(errors="replace") or "another process"
                raise StoreBusyError(
                    f"{path}: {holder} holds the {name} lock; wait for it, or stop it"
                ) from None
            time.sleep(0.05)
        except OSError as error:  # a file system without locks
            raise RequestError(f"{path}: cannot be locked ({error.strerror})") from error
