"""The folder in which a store is built, and what killed ingests leave of it."""

from __future__ import annotations

import glob
import os
import re
import shlex
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

Say = Callable[[str], object]
_MARK = ".building-"
_BUILDER = re.compile(r"(?:(?P<host>.+)-)?(?P<process>\d+)")


def building_folder(target: Path) -> Path:
    """The hidden folder beside `target` in which this process builds; host and process name it."""
    return target.with_name(f".{target.name}{_MARK}{_host()}-{os.getpid()}")


def remove_leftovers(target: Path, say: Say) -> None:
    """Remove what dead processes of this host have left of a store, and name what else is there.

    Folders of living processes and of other hosts stay. `say` gets a line for each folder.
    """
    for folder in sorted(target.parent.glob(f".{glob.escape(target.name)}{_MARK}*")):
        named = _BUILDER.fullmatch(folder.name.rpartition(_MARK)[2])
        if named is None or folder.is_symlink() or not folder.is_dir():
            continue
        host, process = named["host"], int(named["process"])
        own = host == _host() and process == os.getpid()
        if host == _host() and (own or not _is_running(process)):
            shutil.rmtree(folder, ignore_errors=True)
            if not folder.exists():
                say(f"{folder}: removed; an interrupted ingest (process {process}) had left it")
                continue
        where = f"on {host} " if host not in (None, _host()) else ""
        say(
            f"{folder}: left by another ingest (process {process} {where}".rstrip() + "); "
            f"when that has ended, remove it with: rm -r {shlex.quote(str(folder))}"
        )


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9.-]", "_", socket.gethostname()) or "localhost"


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
