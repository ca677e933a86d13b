"""Identify processes across hosts, restarts and reused process ids.

A process id alone says little: another host, container or boot may use the same number. The
identity of a process therefore has the host name, the boot id of the kernel, the namespace of
process ids (containers on one kernel have several), the id, and the start time of the process.
"""

from __future__ import annotations

import os
import re
import secrets
import socket
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

_NAME = Annotated[str, msgspec.Meta(pattern=r"\A[A-Za-z0-9_.-]{1,255}\Z")]
_MARK = Annotated[str, msgspec.Meta(max_length=64)]
_PROCESSES = Path("/proc")


class ProcessIdentity(msgspec.Struct, frozen=True):
    """A process; `boot` and `namespace` are empty where the system does not state them.

    `start` counts the clock ticks from the boot to the start of the process; 0 if unknown.
    """

    host: _NAME
    boot: _MARK
    namespace: _MARK
    process: Annotated[int, msgspec.Meta(ge=1, le=2**31 - 1)]
    start: Annotated[int, msgspec.Meta(ge=0, le=2**62)]

    def __str__(self) -> str:
        return f"process {self.process} on {self.host}"


def this_process() -> ProcessIdentity:
    """The identity of the calling process."""
    process = os.getpid()
    start, _ = _start_and_state(process) or (0, "")
    return ProcessIdentity(host_name(), _boot_id(), _namespace(), process, start)


def has_ended(identity: ProcessIdentity) -> bool:
    """Whether a process certainly runs no more; False where that cannot be decided.

    It can be decided only from the same host, boot and namespace of process ids. A process that was
    killed and that its parent has not waited for counts as ended.
    """
    here = (host_name(), _boot_id(), _namespace())
    if (identity.host, identity.boot, identity.namespace) != here or not all(here):
        return False
    if not _is_running(identity.process):
        return True
    status = _start_and_state(identity.process)
    if status is None:  # of another user, and hidden
        return False
    start, state = status
    return state in "ZX" or (0 not in (start, identity.start) and start != identity.start)


def _is_running(process: int) -> bool:
    """Whether this machine has a process of that number."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return process > 0


def host_name() -> str:
    """The name of this machine, in characters that a file name may have."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", socket.gethostname())[:255] or "localhost"


def process_token() -> str:
    """A random name of the calling process; it stays the same until the process ends."""
    return _token_of(os.getpid())


@cache
def _token_of(process: int) -> str:
    return secrets.token_hex(8)


@cache
def _boot_id() -> str:
    try:
        return (_PROCESSES / "sys/kernel/random/boot_id").read_text().strip()[:64]
    except OSError:
        return ""


def _namespace() -> str:
    try:
        return os.readlink(_PROCESSES / "self/ns/pid")[:64]
    except OSError:
        return ""


def _start_and_state(process: int) -> tuple[int, str] | None:
    """Start in clock ticks since the boot, and the state letter, of `/proc/PROCESS/stat`."""
    try:
        text = (_PROCESSES / str(process) / "stat").read_text(errors="replace")
        fields = text.rpartition(")")[2].split()  # the name before it may hold blanks
        return int(fields[19]), fields[0]
    except (OSError, ValueError, IndexError):
        return None
