"""Open, read and list the files of a store without following symbolic links.

A store may come from somebody else. Every path below its root is opened one component at a time
with `O_NOFOLLOW`, so that a symbolic link inside the store never leads a read, a write or a
removal elsewhere; the root itself may be a link. Only regular files are opened: a FIFO or a device
is refused before anything is read from it. Errors carry the full path of the file. Writing is in
`atomic_writes`.
"""

from __future__ import annotations

import errno
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path, PurePosixPath
from typing import Literal

from s2rstore.errors import RequestError
from s2rstore.files import input_files

Kind = Literal["file", "folder", "link", "other"]

_MAX_DEPTH = 24
"""Levels of nested folders; a store has about 8."""
NO_FOLLOW = os.O_NOFOLLOW | os.O_CLOEXEC
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | NO_FOLLOW
_FILE_FLAGS = os.O_NONBLOCK | os.O_NOCTTY | NO_FOLLOW


class LinkError(RequestError):
    """A path inside a store leads through a symbolic link."""

    def __init__(self, path: Path) -> None:
        super().__init__(
            f"{path}: a symbolic link, which is not followed inside a store; "
            "put the file itself there, or remove the link"
        )


@dataclass(frozen=True, slots=True)
class FolderEntry:
    """An entry below a store's root: its path there, its kind, and its size in bytes."""

    path: str
    kind: Kind
    bytes: int

    @property
    def name(self) -> str:
        return self.path.rpartition("/")[2]


def parts_of(root: Path, relative: str | Path) -> tuple[str, ...]:
    """The components of a path below `root`; RequestError where it leads out of the store."""
    text = relative if isinstance(relative, str) else PurePosixPath(relative).as_posix()
    parts = tuple(part for part in text.split("/") if part not in ("", "."))
    if text.startswith("/") or ".." in parts or "\0" in text:
        raise RequestError(f"{root}: names {text!r}, which lies outside; do not trust it")
    return parts


@contextmanager
def folder(root: Path, relative: str | Path = "", create: bool = False) -> Iterator[int]:
    """A descriptor of a folder below `root`; with `create` missing folders are made.

    Raises LinkError for a link on the way, FileNotFoundError and other OSErrors with the full path.
    """
    path = os.fspath(root)
    descriptor = open_descriptor(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        for part in parts_of(root, relative):
            path = f"{path}/{part}"
            if create:
                with suppress(FileExistsError), errors_of(path):
                    os.mkdir(part, dir_fd=descriptor)
            deeper = open_descriptor(path, _FOLDER, descriptor)
            os.close(descriptor)
            descriptor = deeper
        yield descriptor
    finally:
        os.close(descriptor)


@contextmanager
def parent_folder(
    root: Path, relative: str | Path, create: bool = False
) -> Iterator[tuple[int, str]]:
    """A descriptor of the folder that holds `relative`, and the name in it."""
    *above, name = parts_of(root, relative)
    with folder(root, "/".join(above), create) as descriptor:
        yield descriptor, name


def open_descriptor(path: str | Path, flags: int, folder: int | None = None) -> int:
    """`os.open` of a path's last component, with errors that name the path."""
    name = os.fspath(path)
    if folder is not None:
        name = name.rpartition("/")[2]
    try:
        return os.open(name, flags, 0o666, dir_fd=folder)
    except OSError as error:
        if folder is not None and kind_in(folder, name) == "link":
            raise LinkError(Path(path)) from error
        raise OSError(error.errno, error.strerror, str(path)) from error


def kind_in(folder: int, name: str) -> Kind | None:
    try:
        return _kind_of(os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode)
    except OSError:
        return None


def _kind_of(mode: int) -> Kind:
    if stat.S_ISREG(mode):
        return "file"
    if stat.S_ISDIR(mode):
        return "folder"
    return "link" if stat.S_ISLNK(mode) else "other"


@contextmanager
def errors_of(path: str | Path) -> Iterator[None]:
    """Errors of the operating system name `path`."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def open_read(root: Path, relative: str | Path) -> FileIO:
    """A regular file, opened for reading without a buffer.

    Raises FileNotFoundError where it is missing, RequestError where it is a link or no file.
    """
    return FileIO(open_regular(root, relative, os.O_RDONLY), "rb")


def open_regular(root: Path, relative: str | Path, flags: int) -> int:
    """A descriptor of a regular file below `root`; RequestError for anything else.

    With `os.O_CREAT` among the flags, missing folders are made, too.
    """
    path = root / relative
    with parent_folder(root, relative, create=bool(flags & os.O_CREAT)) as (parent, _):
        return open_regular_at(path, flags, parent)


def open_regular_at(path: Path, flags: int, folder: int | None) -> int:
    """A descriptor of a regular file in an open folder, or of the whole path without one.

    Raises LinkError where the file itself is a link, RequestError for any other kind of file.
    """
    try:
        return _checked_descriptor(open_descriptor(path, flags | _FILE_FLAGS, folder), path)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise LinkError(path) from error
        raise


def _checked_descriptor(descriptor: int, path: Path) -> int:
    """The descriptor of a regular file; any other is closed and raises RequestError."""
    try:
        input_files.refuse_special(path, os.fstat(descriptor).st_mode)
    except RequestError:
        os.close(descriptor)
        raise
    return descriptor


def read(root: Path, relative: str | Path, limit: int | None = None) -> bytes:
    """A file's content; RequestError where it has more than `limit` bytes."""
    path = root / relative
    with open_read(root, relative) as file, errors_of(path):
        return input_files.content_of(file, path, sys.maxsize if limit is None else limit)


def sha256(root: Path, relative: str | Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with open_read(root, relative) as file, errors_of(root / relative):
        return input_files.digest(file)


def size(root: Path, relative: str | Path) -> int:
    """Bytes of a file."""
    with open_read(root, relative) as file:
        return os.fstat(file.fileno()).st_size


def kind(root: Path, relative: str | Path) -> Kind | None:
    """The kind of a path below `root`, where links are not followed; None for a missing one."""
    try:
        with parent_folder(root, relative) as (parent, name):
            return kind_in(parent, name)
    except (FileNotFoundError, NotADirectoryError):
        return None


def checked_path(root: Path, relative: str | Path) -> Path:
    """The path of a file below `root`, for libraries that open files by path.

    Raises LinkError where a component is a link, RequestError where the file is a FIFO, a device
    or a folder. A missing file is left to whoever opens it.
    """
    path = root / relative
    with suppress(FileNotFoundError, NotADirectoryError), parent_folder(root, relative) as (at, _):
        try:
            mode = os.stat(path.name, dir_fd=at, follow_symlinks=False).st_mode
        except OSError:
            return path
        if stat.S_ISLNK(mode):
            raise LinkError(path)
        input_files.refuse_special(path, mode)
    return path


def checked_folder(root: Path, relative: str | Path) -> Path | None:
    """The path of a folder below `root` that holds files and folders alone; None without one.

    Raises LinkError for a link in it, RequestError for a FIFO or a device.
    """
    if kind(root, relative) is None:
        return None
    with folder(root, relative):
        for entry in walk(root, relative):
            if entry.kind == "link":
                raise LinkError(root / entry.path)
            if entry.kind == "other":
                raise RequestError(f"{root / entry.path}: a pipe or a device; remove it")
    return root / relative


def names(root: Path, relative: str | Path) -> list[FolderEntry]:
    """The entries of a folder, by name; none where there is no such folder."""
    entries = []
    with (
        suppress(FileNotFoundError),
        folder(root, relative) as descriptor,
        os.scandir(descriptor) as items,
    ):
        for item in items:
            with suppress(FileNotFoundError):  # removed in the meantime
                status = item.stat(follow_symlinks=False)
                path = (PurePosixPath(relative) / item.name).as_posix()
                entries.append(FolderEntry(path, _kind_of(status.st_mode), status.st_size))
    return sorted(entries, key=lambda entry: entry.path)


def walk(root: Path, relative: str | Path = "") -> Iterator[FolderEntry]:
    """All entries below a folder, a folder before its content; links are not followed.

    Raises RequestError for folders that are nested more deeply than those of any store.
    """
    waiting = [str(relative)]
    while waiting:
        entries = names(root, waiting.pop())
        yield from entries
        for entry in reversed(entries):
            if entry.kind == "folder":
                if entry.path.count("/") > _MAX_DEPTH:
                    raise RequestError(f"{root / entry.path}: folders nested too deeply; remove it")
                waiting.append(entry.path)


def error_text(error: OSError) -> str:
    """The reason why a file could not be read or written, for a message."""
    if error.errno in (errno.ENOTDIR, errno.EISDIR):
        return "a folder in place of a file, or a file in place of a folder"
    return error.strerror or type(error).__name__
