"""Files of results: whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes


def check_writable(asked: Mapping[str, Path | None], read: Mapping[str, Path | None]) -> None:
    """Before anything is computed: whether the files `asked` for, by option, can be written.

    Raises RequestError where one cannot, or is another one, or one of those that are `read`.
    """
    taken = {path.resolve(): option for option, path in read.items() if path is not None}
    for option, path in asked.items():
        if path is None:
            continue
        if not path.name or path.is_dir():
            raise RequestError(f"{option} {path}: a folder; name a file")
        if path.exists() and not path.is_file():
            raise RequestError(f"{option} {path}: a device or a pipe; name a file")
        if not path.parent.is_dir():
            raise RequestError(f"{option} {path}: no such folder as {path.parent}; make it")
        if not os.access(path.parent, os.W_OK | os.X_OK):
            raise RequestError(f"{option} {path}: {path.parent} cannot be written in")
        other = taken.setdefault(path.resolve(), option)
        if other != option:
            raise RequestError(f"{option} {path}: is the file of {other}, too; name another")


def write_all(contents: Mapping[Path, bytes]) -> None:
    """All files or none: their places change when all are on the disk. Raises RequestError."""
    written: dict[Path, Path] = {}
    path = Path()
    try:
        for path, content in contents.items():
            written[path] = atomic_writes.write_partial(path, content)
        for path, beside in written.items():
            beside.replace(path)
            atomic_writes.sync_path(path.parent)
    except OSError as error:
        raise RequestError(f"{path}: {error.strerror or error}") from error
    finally:
        for beside in written.values():
            with suppress(OSError):
                beside.unlink()
