"""Write result files: all of them or none."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes


def check_writable(
    outputs: Mapping[str, Path | None],
    inputs: Mapping[str, Path | None] | None = None,
    devices: bool = False,
) -> None:
    """Check before a computation that its output files, by option, can be written.

    Raises RequestError if one cannot be written, or is also another output or an input; also for a
    device or a pipe, unless the writer takes `devices`.
    """
    read = inputs or {}
    used = {path.resolve(): option for option, path in read.items() if path is not None}
    for option, path in outputs.items():
        if path is None:
            continue
        if not path.name or path.is_dir():
            raise RequestError(f"{option} {path}: a folder; name a file")
        if path.exists() and not path.is_file():
            if devices:
                continue
            raise RequestError(f"{option} {path}: a device or a pipe; name a file")
        folder = path.resolve().parent
        if not folder.is_dir():
            raise RequestError(f"{option} {path}: there is no folder {folder}")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise RequestError(f"{option} {path}: {folder} is not writable")
        other = used.setdefault(path.resolve(), option)
        if other != option:
            raise RequestError(f"{option} {path}: is the file of {other}, too; name another")


def check_folder(option: str, folder: Path) -> None:
    """Raise RequestError, beginning with `option`, unless files can be written to a folder.

    It need not exist yet.
    """
    existing = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise RequestError(f"{option}: cannot write to {existing}; name another folder")


def write_all(contents: Mapping[Path, bytes]) -> None:
    """Write all files beside their paths, then rename them. Raises RequestError."""
    partial: dict[Path, Path] = {}
    path = Path()
    try:
        for path, content in contents.items():
            partial[path] = atomic_writes.write_partial(path, content)
        for path, file in partial.items():
            file.replace(path)
            atomic_writes.sync_path(path.parent)
    except OSError as error:
        raise RequestError(f"{path}: {error.strerror or error}") from error
    finally:
        for file in partial.values():
            with suppress(OSError):
                file.unlink()
