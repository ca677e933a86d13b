"""The hidden folder beside a store in which ingest builds it; killed ingests leave it behind.

Its name holds host and process, so that nobody removes it while it is being built. Version 0.1.0
named the process alone.
"""

from __future__ import annotations

import os
import re
import socket
from dataclasses import dataclass
from pathlib import Path

from s2rstore.files import layout

_MARK = ".building-"
_BUILDER = re.compile(r"(?:(?P<host>.+)-)?(?P<process>\d+)")


@dataclass(frozen=True, slots=True)
class BuildingFolder:
    """A folder with its builder; `host` is None where the name does not state it."""

    path: Path
    host: str | None
    process: int

    @property
    def is_of_this_host(self) -> bool:
        return self.host == _host()

    @property
    def is_abandoned(self) -> bool:
        """Whether its process, of this host or of none that is known, runs no more."""
        return self.host in (None, _host()) and not is_running(self.process)


def building_folder(target: Path) -> Path:
    """Where this process builds the store `target`."""
    return target.with_name(f".{target.name}{_MARK}{_host()}-{os.getpid()}")


def building_folders(target: Path) -> list[BuildingFolder]:
    """All such folders of a store, by name; links are left out."""
    start = f".{target.name}{_MARK}"
    folders = []
    try:
        paths = sorted(target.parent.iterdir())
    except OSError:
        return []
    for path in paths:
        named = path.name.startswith(start) and _BUILDER.fullmatch(path.name.removeprefix(start))
        if named and path.is_dir() and not path.is_symlink():
            folders.append(BuildingFolder(path, named["host"], int(named["process"])))
    return folders


def is_running(process: int) -> bool:
    """Whether this machine has a process of that number."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return process > 0


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9.-]", "_", socket.gethostname()) or "localhost"


def appending_folder(root: Path) -> Path:
    """Where this process writes the frames of new trajectories, inside the store at `root`."""
    return building_folder(root / layout.FRAMES)


def appending_folders(root: Path) -> list[BuildingFolder]:
    """The folders in which processes write frames for the store at `root`, or have left them."""
    return building_folders(root / layout.FRAMES)
