"""A limit on the memory that one query, or reading one untrusted file, may take."""

from __future__ import annotations

import resource
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_limiting = threading.Lock()
"""Limits hold for the whole process, so that two blocks must not overlap."""


@contextmanager
def bounded_memory(more: int, largest_file: int | None = None) -> Iterator[None]:
    """Let this process allocate at most `more` bytes in addition to its present memory.

    With `largest_file` it writes no larger file, either. Beyond that, allocations raise MemoryError
    and writes OSError. This serves libraries that have no limit and allocate the sizes that a file
    declares or a query computes. Only Linux can limit memory; elsewhere the block runs without it.
    """
    limits = {} if largest_file is None else {resource.RLIMIT_FSIZE: largest_file}
    used = _allocated()
    if used is not None:
        limits[resource.RLIMIT_DATA] = used + more
    with _limiting:
        before = {kind: resource.getrlimit(kind) for kind in limits}
        try:
            for kind, limit in limits.items():
                soft, hard = before[kind]
                known = [value for value in (soft, hard) if value != resource.RLIM_INFINITY]
                with suppress(ValueError, OSError):
                    resource.setrlimit(kind, (min([limit, *known]), hard))
            yield
        finally:
            for kind, limits_before in before.items():
                with suppress(ValueError, OSError):
                    resource.setrlimit(kind, limits_before)


def _allocated() -> int | None:
    """Bytes of private writable memory, as RLIMIT_DATA counts them; None where that is unknown."""
    if sys.platform != "linux":
        return None
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmData:")), None)
