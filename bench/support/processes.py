"""Child processes and their memory and processor time, read from /proc."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

_PROC = Path("/proc")


def commands_below(pid: int) -> dict[int, list[str]]:
    """Process ids and command lines of all descendants."""
    parents = _parents()
    below: dict[int, list[str]] = {}
    for child in parents:
        at: int | None = child
        while at is not None and at != pid:
            at = parents.get(at)
        if at == pid and child != pid:
            words = _read(child, "cmdline").split("\0")
            below[child] = [word for word in words if word]
    return below


def applications_below(pid: int) -> list[int]:
    """Ids of the processes below `pid` that are `s2r tui`."""
    return [
        child
        for child, words in commands_below(pid).items()
        if "s2rtui" in words and "tui" in words and Path(words[0]).name.startswith("python")
    ]


def proportional_bytes(pid: int) -> int:
    """Memory of a process, shared pages divided among those that share them (PSS)."""
    for line in _read(pid, "smaps_rollup").splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024
    return 0


def peak_bytes(pid: int) -> int:
    """The most memory that a process has held at a time; 0 where it is gone."""
    for line in _read(pid, "status").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return 0


def processor_seconds(pid: int) -> float:
    """Processor time that a process has used."""
    fields = _read(pid, "stat").rpartition(")")[2].split()
    ticks = int(fields[11]) + int(fields[12]) if len(fields) > 12 else 0
    return ticks / os.sysconf("SC_CLK_TCK")


def is_alive(pid: int) -> bool:
    state = _read(pid, "stat").rpartition(")")[2].split()
    return bool(state) and state[0] != "Z"


def wait_until(holds: Callable[[], bool], patience: float = 30.0, interval: float = 0.05) -> bool:
    """Whether something came true within `patience` seconds; asks every `interval` seconds."""
    limit = time.monotonic() + patience
    while time.monotonic() < limit:
        if holds():
            return True
        time.sleep(interval)
    return False


def program_environment(**variables: str) -> dict[str, str]:
    """The variables of this process and others; a program finds the modules of this process."""
    path = os.pathsep.join(filter(None, sys.path))
    return {**os.environ, "PYTHONPATH": path, **variables}


def _parents() -> dict[int, int]:
    found = {}
    for folder in _PROC.iterdir():
        if folder.name.isdigit():
            fields = _read(int(folder.name), "stat").rpartition(")")[2].split()
            if len(fields) > 1:
                found[int(folder.name)] = int(fields[1])
    return found


def _read(pid: int, name: str) -> str:
    try:
        return (_PROC / str(pid) / name).read_text()
    except OSError:
        return ""
