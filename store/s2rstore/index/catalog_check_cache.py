"""Remember, in the user's cache folder, which index files passed the catalog check.

Comparing the catalog of an index with the known tables takes 60 ms in a new process, more than
all else that opening an index does; hashing it takes 2 ms. So a file is compared once per content.
An entry is an empty file whose name is a SHA-256. Without a folder that belongs to the user alone,
nothing is remembered, and every file is compared.
"""

from __future__ import annotations

import hashlib
import stat
from contextlib import suppress
from pathlib import Path

from s2rstore.files import user_cache

_NAME = "checked-indexes"

MAX_BYTES = 16 << 20
"""Bytes; larger files are not hashed, because opening them takes far longer than the comparison."""

MAX_ENTRIES = 256
"""Entries in the folder; one more removes all others."""


def key(path: Path, expected: str) -> str | None:
    """SHA-256 over the content of `path` and the expected catalog; None for a large file."""
    with suppress(OSError):
        if path.stat().st_size <= MAX_BYTES:
            content = hashlib.sha256(expected.encode())
            content.update(path.read_bytes())
            return content.hexdigest()
    return None


def contains(key: str) -> bool:
    """Whether a file with this key has passed the check before."""
    folder = user_cache.folder(_NAME)
    try:
        return user_cache.is_private(folder) and stat.S_ISREG((folder / key).lstat().st_mode)
    except OSError:
        return False


def add(key: str) -> None:
    """Remember a key; do nothing where the folder cannot be written."""
    folder = user_cache.folder(_NAME)
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not user_cache.is_private(folder):
            return
        entries = list(folder.iterdir())
        if len(entries) >= MAX_ENTRIES:
            for entry in entries:
                entry.unlink(missing_ok=True)
        (folder / key).touch(mode=0o600)
