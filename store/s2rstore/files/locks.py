"""Advisory locks between the processes that write one store.

`publish` is held for the seconds that a new generation takes; `compute` for as long as a process
fills `runs.zarr`. A file that is replaced as a whole has a separate lock. Readers take none.
"""

from __future__ import annotations

import fcntl
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from pathlib import Path

from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import layout, safe_files


def publish_lock(root: Path, timeout: float = 120.0) -> AbstractContextManager[None]:
    """Wait up to `timeout` seconds for other publishers; StoreBusyError after that."""
    return _store_lock(root, "publish", timeout)


def compute_lock(root: Path, timeout: float = 0.0) -> AbstractContextManager[None]:
    """Hold the compute lock; StoreBusyError names the process that holds it already."""
    return _store_lock(root, "compute", timeout)


def file_lock(path: Path, timeout: float = 120.0) -> AbstractContextManager[None]:
    """Wait up to `timeout` seconds for other writers of this file; StoreBusyError after that."""
    with suppress(OSError):
        path.parent.mkdir(exist_ok=True)
    lock = path.with_name(f".{path.name}.lock")
    return _held(partial(safe_files.open_lock, lock), path, "writing", timeout)


def _store_lock(root: Path, name: str, timeout: float) -> AbstractContextManager[None]:
    lock = f"{layout.LEDGER}/{name}.lock"
    open_lock = partial(safe_files.open_regular, root, lock, os.O_RDWR | os.O_CREAT)
    return _held(open_lock, root, name, timeout)


@contextmanager
def _held(open_lock: Callable[[], int], path: Path, name: str, timeout: float) -> Iterator[None]:
    try:
        descriptor = open_lock()
    except OSError as error:
        message = f"{path}: the {name} lock cannot be opened ({error.strerror})"
        raise RequestError(message) from error
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
