"""Write files so that readers see the old content or the new, never a part.

Content goes to a file with a unique name that ends in `.partial`, and takes the place of the old
file when it is complete and on the disk. A process that is killed meanwhile leaves that file:
`partial_files` finds such files in a store, and `s2r prune` removes them.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from s2rstore.files import safe_files
from s2rstore.files.safe_files import NO_FOLLOW, errors_of, parent_folder

PARTIAL = ".partial"

_PARTIAL_NAME = re.compile(r".*\.partial|\.building-.*", re.DOTALL)
"""The names of unfinished files."""

Content = bytes | bytearray | memoryview | Iterator[bytes]
"""What a file shall hold; an iterator is written piece by piece."""


def write(
    root: Path,
    relative: str | Path,
    content: Content,
    durable: bool = True,
    check: Callable[[], None] = lambda: None,
) -> None:
    """Write a file below `root`; missing folders are made.

    Without `durable` the content reaches the disk with a later `sync`. `check` is called directly
    before the old file is replaced; what it raises leaves the old file. Raises OSError that names
    the file.
    """
    path = root / relative
    with parent_folder(root, relative, create=True) as (parent, name):
        partial = _write_partial(path, parent, content, durable)
        try:
            check()
            with errors_of(path):
                os.replace(partial, name, src_dir_fd=parent, dst_dir_fd=parent)
                if durable:
                    os.fsync(parent)
        except BaseException:
            with suppress(OSError):
                os.unlink(partial, dir_fd=parent)
            raise


def write_attempt(
    root: Path,
    relative: str | Path,
    content: Content,
    durable: bool = True,
    create_folder: bool = False,
) -> str:
    """Write content that shall become the file `relative`, under a unique name in its folder.

    Returns the path of that unfinished file below `root`. `rename` makes it the file;
    `flush_and_rename` does so for one that was not written durably. Several processes, also of
    several hosts, may write one file at once. The folder must exist, unless `create_folder`.
    """
    with parent_folder(root, relative, create_folder) as (parent, _):
        name = _write_partial(root / relative, parent, content, durable)
    return (Path(relative).parent / name).as_posix()


def flush_and_rename(root: Path, attempt: str, relative: str | Path) -> None:
    """Make an unfinished file below `root` the file `relative` of its folder, durably.

    Where that fails, the unfinished file is removed.
    """
    path = root / relative
    new_name = safe_files.parts_of(root, relative)[-1]
    with parent_folder(root, attempt) as (parent, name), errors_of(path):
        try:
            descriptor = safe_files.open_regular_at(root / attempt, os.O_RDONLY, parent)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
            os.replace(name, new_name, src_dir_fd=parent, dst_dir_fd=parent)
            os.fsync(parent)
        except BaseException:
            with suppress(OSError):
                os.unlink(name, dir_fd=parent)
            raise


def write_file(path: Path, content: Content, check: Callable[[], None] = lambda: None) -> None:
    """Write a file outside a store, in a folder that exists and may be reached by links.

    `check` is called directly before the old file is replaced, as in `write`.
    """
    partial = write_partial(path, content)
    try:
        check()
        with errors_of(path):
            partial.replace(path)
    except BaseException:
        with suppress(OSError):
            partial.unlink()
        raise
    sync_path(path.parent)


def write_partial(path: Path, content: Content) -> Path:
    """Write content to the disk, into a hidden file that can replace `path` later.

    Uses whole paths, not folder descriptors, because a restricted process checks these paths.
    """
    return path.with_name(_write_partial(path, None, content, durable=True))


def _write_partial(path: Path, parent: int | None, content: Content, durable: bool) -> str:
    partial = f".{path.name[:64]}.{secrets.token_hex(8)}{PARTIAL}"
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_FOLLOW
    descriptor = safe_files.open_descriptor(path.with_name(partial), flags, parent)
    try:
        with errors_of(path), os.fdopen(descriptor, "wb") as file:
            file.writelines(content if isinstance(content, Iterator) else [content])
            file.flush()
            if durable:
                os.fsync(descriptor)
    except BaseException:
        with suppress(OSError):
            os.unlink(path.with_name(partial) if parent is None else partial, dir_fd=parent)
        raise
    return partial


def append_lines(root: Path, relative: str | Path, lines: bytes) -> None:
    """Append whole lines durably; a line that a killed process left unfinished is ended first."""
    path, flags = root / relative, os.O_RDWR | os.O_APPEND | os.O_CREAT
    with parent_folder(root, relative, create=True) as (parent, _):
        descriptor = safe_files.open_regular_at(path, flags, parent)
        with os.fdopen(descriptor, "ab") as file, errors_of(path):
            size = os.fstat(descriptor).st_size
            if size and os.pread(descriptor, 1, size - 1) != b"\n":
                lines = b"\n" + lines
            file.write(lines)
            file.flush()
            os.fsync(descriptor)
            if not size:  # the name is new
                os.fsync(parent)


def make_folder(root: Path, relative: str | Path) -> None:
    """Make a folder below `root`, and the folders above it, where they are missing."""
    with safe_files.folder(root, relative, create=True):
        pass


def sync(root: Path, relative: str | Path) -> None:
    """Flush a file below `root` and its name in its folder to the disk."""
    with safe_files.open_read(root, relative) as file, errors_of(root / relative):
        os.fsync(file.fileno())
    with parent_folder(root, relative) as (parent, _):
        os.fsync(parent)


def sync_path(path: Path) -> None:
    """Flush a file or a folder outside a store to the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def rename(root: Path, old: str, new: str, durable: bool = True) -> None:
    """Rename a file in its folder; without `durable` the name reaches the disk later."""
    with parent_folder(root, old) as (parent, name), errors_of(root / new):
        new_name = safe_files.parts_of(root, new)[-1]
        os.replace(name, new_name, src_dir_fd=parent, dst_dir_fd=parent)
        if durable:
            os.fsync(parent)


def move(root: Path, old: str | Path, new: str | Path) -> None:
    """Move a file or a folder below `root`, durably; missing folders above `new` are made.

    Raises OSError that names `new` where it exists.
    """
    with (
        parent_folder(root, old) as (old_parent, old_name),
        parent_folder(root, new, create=True) as (parent, name),
        errors_of(root / new),
    ):
        if safe_files.kind_in(parent, name) is not None:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        os.rename(old_name, name, src_dir_fd=old_parent, dst_dir_fd=parent)
        os.fsync(parent)
        os.fsync(old_parent)


def link(root: Path, old: str, new: str) -> None:
    """Give a file below `root` a second name, in place of a file that has it; folders are made.

    The name reaches the disk with a later `sync`. Raises OSError that names `new` where the file
    system has no hard links, and where `old` is no regular file.
    """
    with (
        parent_folder(root, old) as (old_parent, old_name),
        parent_folder(root, new, create=True) as (parent, name),
        errors_of(root / new),
    ):
        os.close(safe_files.open_regular_at(root / old, os.O_RDONLY, old_parent))
        with suppress(FileNotFoundError):
            os.unlink(name, dir_fd=parent)
        os.link(old_name, name, src_dir_fd=old_parent, dst_dir_fd=parent, follow_symlinks=False)


def remove(root: Path, relative: str | Path) -> None:
    """Remove a file or a folder with its content; a link is removed, not its target."""
    with (
        suppress(FileNotFoundError),
        parent_folder(root, relative) as (parent, name),
        errors_of(root / relative),
    ):
        if safe_files.kind_in(parent, name) == "folder":
            shutil.rmtree(name, dir_fd=parent)
        else:
            os.unlink(name, dir_fd=parent)


def is_partial(name: str) -> bool:
    """Whether a file of this name is one that a killed write has left, or that is being written."""
    return _PARTIAL_NAME.fullmatch(name) is not None


def partial_files(root: Path) -> list[safe_files.FolderEntry]:
    """List the unfinished files that killed writes have left in a store."""
    return [
        entry for entry in safe_files.walk(root) if entry.kind == "file" and is_partial(entry.name)
    ]
