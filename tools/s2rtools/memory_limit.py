"""A limit on the memory that reading one untrusted file may take."""

from __future__ import annotations

import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def bounded_memory(more: int, largest_file: int) -> Iterator[None]:
    """Let this process allocate at most `more` bytes beyond what it has, and write no larger file.

    Beyond that, allocations raise MemoryError and writes OSError. For libraries that inflate what
    a file declares without a limit of their own. Linux alone can bound memory so; elsewhere the
    block runs without a limit on memory.
    """
    limits = {resource.RLIMIT_FSIZE: largest_file}
    if sys.platform == "linux":
        limits[resource.RLIMIT_DATA] = _allocated() + more
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


def _allocated() -> int:
    """Bytes of private writable memory, as RLIMIT_DATA counts them."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmData:"):
            return int(line.split()[1]) * 1024
    return 1 << 40
