"""Files of a store, opened without following links.

A store may come from somebody else. Every path below its root is opened one component at a time
with `O_NOFOLLOW`, so that a symbolic link inside the store never leads a read, a write or a
removal elsewhere; the root itself may be a link. Only regular files are opened: a FIFO or a device
is refused before anything is read from it. Errors carry the full path of the file.

A write goes to a file with a unique name that ends in `.partial` and takes the place of the old
file when it is complete and on the disk. A process that is killed meanwhile leaves that file:
`leftovers` finds such files, and `s2r prune` removes them.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path, PurePosixPath
from typing import Literal

from s2rstore.errors import RequestError

Kind = Literal["file", "folder", "link", "other"]
PARTIAL = ".partial"

_MOST_LEVELS = 24
"""Folders within each other; those of a store lie about 8 deep."""
_SAFE = os.O_NOFOLLOW | os.O_CLOEXEC
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | _SAFE
_FILE = os.O_NONBLOCK | os.O_NOCTTY | _SAFE
_LEFTOVER = re.compile(
    r".*\.partial|\.building-.*|\.(CURRENT\.json|compacted\.jsonl|[0-9a-f]{64}\.\w+)\.\d+"
    r"|\..*\.duckdb\.\d+\.new(\.wal)?",
    re.DOTALL,
)


class LinkError(RequestError):
    """A path inside a store leads through a symbolic link."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Something below a store's root: its path there, what it is, and its size in bytes."""

    path: str
    kind: Kind
    bytes: int

    @property
    def name(self) -> str:
        return self.path.rpartition("/")[2]


def parts_of(root: Path, relative: str | Path) -> tuple[str, ...]:
    """The components of a path below `root`; RequestError where it leads out of the store."""
    path = PurePosixPath(relative)
    if path.is_absolute() or ".." in path.parts or "\0" in str(path):
        raise RequestError(f"{root}: names {str(relative)!r}, which lies outside; do not trust it")
    return path.parts


@contextmanager
def folder(root: Path, relative: str | Path = "", create: bool = False) -> Iterator[int]:
    """A descriptor of a folder below `root`.

    Raises LinkError for a link on the way, FileNotFoundError and other OSErrors with the full
    path. `create` makes what is missing below `root`.
    """
    path = root
    descriptor = _opened(root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        for part in parts_of(root, relative):
            path = path / part
            if create:
                with suppress(FileExistsError), _naming(path):
                    os.mkdir(part, dir_fd=descriptor)
            deeper = _opened(path, _FOLDER, descriptor)
            os.close(descriptor)
            descriptor = deeper
        yield descriptor
    finally:
        os.close(descriptor)


@contextmanager
def _parent(root: Path, relative: str | Path, create: bool = False) -> Iterator[tuple[int, str]]:
    """A descriptor of the folder that holds `relative`, and the name in it."""
    *above, name = parts_of(root, relative)
    with folder(root, "/".join(above), create) as descriptor:
        yield descriptor, name


def _opened(path: Path, flags: int, folder: int | None = None, mode: int = 0o666) -> int:
    """`os.open` of a path's last component, with errors that name the path."""
    name = os.fspath(path) if folder is None else path.name
    try:
        return os.open(name, flags, mode, dir_fd=folder)
    except OSError as error:
        if folder is not None and _kind(folder, name) == "link":
            raise link_error(path) from error
        raise OSError(error.errno, error.strerror, str(path)) from error


def link_error(path: Path) -> LinkError:
    """What is said of a link inside a store."""
    return LinkError(
        f"{path}: a symbolic link, which is not followed inside a store; "
        "put the file itself there, or remove the link"
    )


def _kind(folder: int, name: str) -> Kind | None:
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
def _naming(path: Path) -> Iterator[None]:
    """Errors of the operating system name `path`."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def open_read(root: Path, relative: str | Path) -> FileIO:
    """A regular file, opened for reading without a buffer.

    Raises FileNotFoundError where it is missing, RequestError where it is a link or no file.
    """
    return FileIO(_descriptor(root, relative, os.O_RDONLY | _FILE), "rb")


def _descriptor(root: Path, relative: str | Path, flags: int) -> int:
    path = root / relative
    with _parent(root, relative, create=bool(flags & os.O_CREAT)) as (parent, _):
        return _regular(_opened(path, flags, parent), path)


def _regular(descriptor: int, path: Path) -> int:
    """Return the descriptor if it is a regular file, else close it and raise RequestError."""
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        is_folder = stat.S_ISDIR(os.fstat(descriptor).st_mode)
        os.close(descriptor)
        what = "a folder" if is_folder else "a pipe or a device"
        raise RequestError(f"{path}: {what}, not a file; restore the file")
    return descriptor


def read(root: Path, relative: str | Path, limit: int | None = None) -> bytes:
    """A file's content; RequestError where it has more than `limit` bytes."""
    with open_read(root, relative) as file, _naming(root / relative):
        size = os.fstat(file.fileno()).st_size
        if limit is not None and size > limit:
            raise RequestError(f"{root / relative}: {size} bytes, at most {limit} are read")
        content = bytearray()
        while block := file.read(min(max(size - len(content), 0) + 1, 1 << 24)):
            content += block
            if limit is not None and len(content) > limit:
                raise RequestError(f"{root / relative}: grows while it is read; try again")
    return bytes(content)


def sha256(root: Path, relative: str | Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with open_read(root, relative) as file, _naming(root / relative):
        return hashlib.file_digest(file, "sha256").hexdigest()


def size(root: Path, relative: str | Path) -> int:
    """Bytes of a file."""
    with open_read(root, relative) as file:
        return os.fstat(file.fileno()).st_size


def kind(root: Path, relative: str | Path) -> Kind | None:
    """What a path below `root` is, not followed; None where nothing is there."""
    try:
        with _parent(root, relative) as (parent, name):
            return _kind(parent, name)
    except (FileNotFoundError, NotADirectoryError):
        return None


def checked_path(root: Path, relative: str | Path) -> Path:
    """The path of a file below `root`, for libraries that open files by path.

    Raises LinkError where a component is a link, RequestError where the file is a FIFO, a device
    or a folder. A file that is missing is left to whoever opens it.
    """
    path = root / relative
    found = kind(root, relative)
    if found == "link":
        raise link_error(path)
    if found in ("folder", "other"):
        what = "a folder" if found == "folder" else "a pipe or a device"
        raise RequestError(f"{path}: {what}, not a file; restore the file")
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
                raise link_error(root / entry.path)
            if entry.kind == "other":
                raise RequestError(f"{root / entry.path}: a pipe or a device; remove it")
    return root / relative


def names(root: Path, relative: str | Path) -> list[Entry]:
    """What lies in a folder, by name; nothing where there is no such folder."""
    try:
        with folder(root, relative) as descriptor, os.scandir(descriptor) as found:
            lying = [entry for item in found if (entry := _entry(relative, item)) is not None]
            return sorted(lying, key=lambda entry: entry.path)
    except FileNotFoundError:
        return []


def _entry(above: str | Path, item: os.DirEntry[str]) -> Entry | None:
    """The entry of a folder; None if it was removed in the meantime."""
    path = (PurePosixPath(above) / item.name).as_posix()
    try:
        status = item.stat(follow_symlinks=False)
    except FileNotFoundError:
        return None
    return Entry(path, _kind_of(status.st_mode), status.st_size)


def walk(root: Path, relative: str | Path = "") -> Iterator[Entry]:
    """Everything below a folder, links among it, which are not followed; a folder comes first.

    Raises RequestError for folders that lie deeper within each other than those of any store.
    """
    waiting = [str(relative)]
    while waiting:
        entries = names(root, waiting.pop())
        yield from entries
        for entry in reversed(entries):
            if entry.kind == "folder":
                if entry.path.count("/") > _MOST_LEVELS:
                    raise RequestError(f"{root / entry.path}: folders nested too deeply; remove it")
                waiting.append(entry.path)


def make_folder(root: Path, relative: str | Path) -> None:
    """Make a folder below `root` and those above it, where they are missing."""
    with folder(root, relative, create=True):
        pass


def write(
    root: Path,
    relative: str | Path,
    content: bytes | bytearray | memoryview,
    durable: bool = True,
) -> None:
    """Write a file; readers see the old content or the new, never a part.

    Folders that are missing are made. Without `durable` it is left to `sync` to bring the file to
    the disk. Raises OSError that names the file.
    """
    path = root / relative
    with _parent(root, relative, create=True) as (parent, name):
        partial = f".{name[:64]}.{secrets.token_hex(8)}{PARTIAL}"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _SAFE
        descriptor = _opened(path.with_name(partial), flags, parent)
        try:
            with _naming(path):
                with FileIO(descriptor, "wb") as file:
                    _write_all(file, content)
                    if durable:
                        os.fsync(file.fileno())
                os.replace(partial, name, src_dir_fd=parent, dst_dir_fd=parent)
                if durable:
                    os.fsync(parent)
        except BaseException:
            with suppress(OSError):
                os.unlink(partial, dir_fd=parent)
            raise


def _write_all(file: FileIO, content: bytes | bytearray | memoryview) -> None:
    rest = memoryview(content).cast("B")
    while rest:
        rest = rest[file.write(rest) :]


def append_lines(root: Path, relative: str | Path, lines: bytes) -> None:
    """Append whole lines durably; a line that a killed process left unfinished is ended first."""
    descriptor = _descriptor(root, relative, os.O_RDWR | os.O_APPEND | os.O_CREAT | _FILE)
    with FileIO(descriptor, "ab") as file, _naming(root / relative):
        size = os.fstat(file.fileno()).st_size
        if size and os.pread(file.fileno(), 1, size - 1) != b"\n":
            lines = b"\n" + lines
        _write_all(file, lines)
        os.fsync(file.fileno())


def lock_file(root: Path, relative: str | Path) -> int:
    """A descriptor of a file that is only locked; it is made where it is missing."""
    return _descriptor(root, relative, os.O_RDWR | os.O_CREAT | _FILE)


def lock_beside(path: Path) -> int:
    """As `lock_file`, for a file outside of a store: its folder may be reached by links."""
    try:
        return _regular(os.open(path, os.O_RDWR | os.O_CREAT | _FILE, 0o666), path)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise link_error(path) from error
        raise


def sync(root: Path, relative: str | Path) -> None:
    """Bring a file and its name in its folder to the disk."""
    with open_read(root, relative) as file, _naming(root / relative):
        os.fsync(file.fileno())
    with _parent(root, relative) as (parent, _):
        os.fsync(parent)


def rename(root: Path, old: str, new: str) -> None:
    """Give a file another name in its folder, durably."""
    with _parent(root, old) as (parent, name), _naming(root / new):
        os.replace(name, parts_of(root, new)[-1], src_dir_fd=parent, dst_dir_fd=parent)
        os.fsync(parent)


def remove(root: Path, relative: str | Path) -> None:
    """Remove a file or a folder with all that is in it; links themselves, not their targets."""
    with (
        suppress(FileNotFoundError),
        _parent(root, relative) as (parent, name),
        _naming(root / relative),
    ):
        if _kind(parent, name) == "folder":
            shutil.rmtree(name, dir_fd=parent)
        else:
            os.unlink(name, dir_fd=parent)


def leftovers(root: Path) -> list[Entry]:
    """Unfinished files that killed writes have left in a store."""
    return [
        entry for entry in walk(root) if entry.kind == "file" and _LEFTOVER.fullmatch(entry.name)
    ]


def explained(error: OSError) -> str:
    """Why a file could not be read or written, in words."""
    if error.errno in (errno.ENOTDIR, errno.EISDIR):
        return "a folder stands where a file belongs, or a file where a folder belongs"
    return error.strerror or type(error).__name__
