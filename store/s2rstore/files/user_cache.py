"""Folders in the user's cache, `$XDG_CACHE_HOME/s2rtui`, whose content nobody else can change."""

from __future__ import annotations

import os
import stat
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
