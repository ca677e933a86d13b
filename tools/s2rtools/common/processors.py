"""The processors and the memory that this process may use, which a batch system can limit."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

_CONTROL_GROUPS = (
    (r"^0::/(.*)$", "/sys/fs/cgroup", ("memory.max", "memory.current", "inactive_file")),
    (r"^\d+:memory:/(.*)$", "/sys/fs/cgroup/memory",
     ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")),
)  # fmt: skip
"""Both versions: pattern in /proc/self/cgroup, folder, and files of limit and usage."""


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
    groups = _read(Path("/proc/self/cgroup"))
    for pattern, folder, names in _CONTROL_GROUPS:
        if match := re.search(pattern, groups, re.MULTILINE):
            found += _left_by_groups(Path(folder), match[1], names)
    return min(found, default=None)


def _left_by_groups(root: Path, path: str, names: tuple[str, str, str]) -> Iterator[int]:
    """Bytes that a control group and those around it leave; `names` are files and an entry.

    File contents that the kernel can drop do not count as used.
    """
    limit_file, used_file, droppable = names
    inner = root / path
    for group in (inner, *inner.parents):
        limit, used = (_read(group / name).strip() for name in (limit_file, used_file))
        if limit.isdigit() and used.isdigit():
            entry = re.search(rf"^{droppable} (\d+)$", _read(group / "memory.stat"), re.MULTILINE)
            yield max(0, int(limit) - int(used) + (int(entry[1]) if entry else 0))
        if group == root:
            break


def _read(path: Path) -> str:
    """The text of a file of the kernel; empty where there is none."""
    try:
        return path.read_text()
    except OSError:
        return ""
