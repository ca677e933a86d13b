"""The processors and the memory that this process may use, which a batch system can limit."""

from __future__ import annotations

import os
import re
from pathlib import Path


def available_processors() -> int:
    """The number of processors that this process may run on, at least 1."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


def available_memory() -> int | None:
    """Bytes that this process can still allocate without swapping; None where nothing tells them.

    The least of what Linux calls available and of what the control groups of the process leave.
    """
    found = []
    if match := re.search(
        r"^MemAvailable:\s+(\d+) kB$", _read(Path("/proc/meminfo")), re.MULTILINE
    ):
        found.append(1024 * int(match[1]))
    if match := re.search(r"^0::/(.*)$", _read(Path("/proc/self/cgroup")), re.MULTILINE):
        root = Path("/sys/fs/cgroup")
        inner = root / match[1]
        for group in (inner, *inner.parents):
            limit, used = (_read(group / f"memory.{name}").strip() for name in ("max", "current"))
            if limit.isdigit() and used.isdigit():
                found.append(max(0, int(limit) - int(used)))
            if group == root:
                break
    return min(found, default=None)


def _read(path: Path) -> str:
    """The text of a file of the kernel; empty where there is none."""
    try:
        return path.read_text()
    except OSError:
        return ""
