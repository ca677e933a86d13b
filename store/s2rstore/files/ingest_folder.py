"""The hidden folder beside a store in which ingest builds it; killed ingests leave it behind.

Its name states which process builds it: host, process id, a hash of boot and namespace of process
ids, start time, and random digits, so that two ingests never share one. A folder is abandoned

- when its process was started under the present boot and namespace, and has certainly ended;
- when its name states this host and another boot or namespace, and nothing in it has changed for a
  day: another machine may have the same name.

The folder of another host is never abandoned: whether it is in use cannot be known here.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import time
from dataclasses import dataclass
from pathlib import Path

from s2rstore.files import layout, process_identity
from s2rstore.files.process_identity import ProcessIdentity, host_name

_MARK = ".building-"
_BUILDER = re.compile(
    r"(?P<host>.+?)-(?P<process>\d{1,10})-(?P<boot>[0-9a-f]{8})-(?P<start>\d{1,18})-[0-9a-f]{16}"
)
_DAY = 86_400.0


@dataclass(frozen=True, slots=True)
class StagingFolder:
    """A folder with its builder, for messages, and whether nobody builds in it any more."""

    path: Path
    builder: str
    is_abandoned: bool


def staging_folder(target: Path) -> Path:
    """A new path at which this process can build the store `target`."""
    own = process_identity.this_process()
    builder = f"{own.host}-{own.process}-{_boot_hash(own)}-{own.start}-{secrets.token_hex(8)}"
    return target.with_name(f".{target.name}{_MARK}{builder}")


def staging_folders(target: Path) -> list[StagingFolder]:
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
            builder = f"process {named['process']} on {named['host']}"
            folders.append(StagingFolder(path, builder, _is_abandoned(path, named)))
    return folders


def _is_abandoned(path: Path, named: re.Match[str]) -> bool:
    own = process_identity.this_process()
    if named["host"] != own.host:
        return False
    if own.boot and own.namespace and named["boot"] == _boot_hash(own):
        process, start = int(named["process"]), int(named["start"])
        builder = ProcessIdentity(host_name(), own.boot, own.namespace, process, start)
        return process_identity.has_ended(builder)
    return _is_unchanged_for_a_day(path)


def _boot_hash(identity: ProcessIdentity) -> str:
    return hashlib.sha256(f"{identity.boot} {identity.namespace}".encode()).hexdigest()[:8]


def _is_unchanged_for_a_day(path: Path) -> bool:
    """Whether no file was added to the folder, or any folder below it, for a day."""
    try:
        newest = max(os.stat(folder).st_mtime for folder, _, _ in os.walk(path))
    except (OSError, ValueError):
        return False
    return time.time() - newest > _DAY


def append_staging_folder(root: Path) -> Path:
    """Where this process writes the frames of new trajectories, inside the store at `root`."""
    return staging_folder(root / layout.FRAMES)


def append_staging_folders(root: Path) -> list[StagingFolder]:
    """The folders in which processes write frames for the store at `root`, or have left them."""
    return staging_folders(root / layout.FRAMES)
