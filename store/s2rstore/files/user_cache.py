"""Folders in the user's cache, `$XDG_CACHE_HOME/s2rtui`, whose content nobody else can change."""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path


def folder(name: str) -> Path:
    """The path of a folder of the cache, which may be missing."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    base = named if named.is_absolute() else Path(os.path.expanduser("~")) / ".cache"
    return base / "s2rtui" / name


def is_private(folder: Path) -> bool:
    """Whether nobody but the user can add or replace files in a folder."""
    status = folder.lstat()
    return (
        stat.S_ISDIR(status.st_mode)
        and status.st_uid == os.geteuid()
        and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    )


def private_folder(name: str) -> Path:
    """A folder of the cache, which is made; a temporary one where the cache cannot be used."""
    path = folder(name)
    with suppress(OSError):
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if is_private(path) and os.access(path, os.W_OK):
            return path
    return _temporary_folder()


@cache
def _temporary_folder() -> Path:
    path = Path(tempfile.mkdtemp(prefix="s2r-"))
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path
