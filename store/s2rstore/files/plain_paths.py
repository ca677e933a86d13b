"""Paths that DuckDB takes literally, for files in folders whose names it does not.

DuckDB reads `*`, `?` and `[` as patterns, `\\` as a separator of folders and `,` as one of search
paths, and it resolves symbolic links before it opens a file. A file below such a folder is opened
by a hard link in a private folder of this process, or by a copy where the file system has no hard
links. A new file is written there and then moved to its place.

The private folder is `$XDG_CACHE_HOME/s2rtui/plain/TOKEN`. It is removed when the process ends. The
folder of a process that was killed is removed when another process makes its own.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import msgspec

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, process_identity, safe_files, user_cache
from s2rstore.files.process_identity import ProcessIdentity

NAME = "plain"
_NOT_LITERAL = re.compile(r"[*?\[\\,]")
_OWNER = "owner.json"
_BLOCK = 1 << 20


def plain_path(folder: Path, relative: str = "") -> Path:
    """The path by which DuckDB opens a file below `folder`, or the folder itself.

    It is the file's own absolute path where DuckDB takes that literally. Files below one folder
    keep their places relative to each other.
    """
    folder = folder.absolute()
    path = folder / relative
    if not _NOT_LITERAL.search(str(path)):
        return path
    if _NOT_LITERAL.search(relative):
        relative = hashlib.sha256(relative.encode()).hexdigest()
    private = _private_folder(process_identity.process_token())
    return private / hashlib.sha256(os.fsencode(folder)).hexdigest()[:32] / relative


def link(folder: Path, relative: str) -> Path:
    """The path by which DuckDB reads an existing file below `folder`.

    A file that was replaced since the last call is linked again; a missing one is left to whoever
    opens it. Raises RequestError where the file can neither be linked nor copied.
    """
    path, plain = folder.absolute() / relative, plain_path(folder, relative)
    if path == plain:
        return plain
    with _explained(path), suppress(FileNotFoundError):
        with safe_files.open_read(folder, relative) as file:
            status = os.fstat(file.fileno())
            if _is_same(plain, status):
                return plain
            make_parent(plain)
            beside = plain.with_name(f".{secrets.token_hex(8)}")
            if not _hard_linked(path, beside, status):
                with beside.open("xb") as copy:
                    shutil.copyfileobj(file, copy, _BLOCK)
                os.utime(beside, ns=(status.st_atime_ns, status.st_mtime_ns))
        beside.replace(plain)
        beside.unlink(missing_ok=True)  # renaming one link of a file to another does nothing
    return plain


def make_parent(plain: Path) -> None:
    """Make the folder of a new file at a path of `plain_path`."""
    plain.parent.mkdir(mode=0o700, parents=True, exist_ok=True)


def move_back(plain: Path, root: Path, relative: str) -> None:
    """Move a new file from its path of `plain_path` to its place below `root`.

    Does nothing where that is the same path. Raises RequestError where the file cannot be moved.
    """
    path = root.absolute() / relative
    if path == plain:
        return
    with _explained(path):
        try:
            with safe_files.parent_folder(root, relative) as (parent, name):
                os.rename(plain, name, dst_dir_fd=parent)
        except OSError:  # another file system
            atomic_writes.write(root, relative, _blocks(plain))
            plain.unlink()


def discard(folder: Path, relative: str) -> None:
    """Remove an unfinished file below `folder` from its private folder, if it is in one."""
    plain = plain_path(folder, relative)
    if plain != folder.absolute() / relative:
        plain.unlink(missing_ok=True)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise
    except OSError as error:
        raise RequestError(
            f"{path}: DuckDB opens it only by a link or copy in the cache, which failed "
            f"({safe_files.error_text(error)}); free space, set XDG_CACHE_HOME, or rename the "
            "folder so that its path has none of * ? [ \\ ,"
        ) from error


def _blocks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            yield block


def _is_same(plain: Path, status: os.stat_result) -> bool:
    """Whether `plain` is a hard link to a file of this status, or a copy of it."""
    with suppress(FileNotFoundError):
        known = plain.lstat()
        return os.path.samestat(known, status) or (
            (known.st_size, known.st_mtime_ns) == (status.st_size, status.st_mtime_ns)
        )
    return False


def _hard_linked(path: Path, link: Path, status: os.stat_result) -> bool:
    """Whether `link` could be made as another name of the file of this status."""
    with suppress(OSError):
        os.link(path, link, follow_symlinks=False)
        if os.path.samestat(link.lstat(), status):
            return True
        link.unlink()  # `path` was replaced in the meantime
    return False


@cache
def _private_folder(token: str) -> Path:
    """The private folder of the process with this token, which is the calling one."""
    base = user_cache.private_folder(NAME)
    if _NOT_LITERAL.search(str(base)):
        base = Path(tempfile.mkdtemp(prefix="s2r-", dir="/tmp"))
        atexit.register(_remove_own, base, os.getpid())
    _remove_abandoned(base)
    folder = base / token
    folder.mkdir(mode=0o700, exist_ok=True)
    (folder / _OWNER).write_bytes(msgspec.json.encode(process_identity.this_process()))
    atexit.register(_remove_own, folder, os.getpid())
    return folder


def _remove_own(folder: Path, process: int) -> None:
    if os.getpid() == process:  # not in a process that was forked from it
        _remove(folder)


def _remove_abandoned(base: Path) -> None:
    """Remove the private folders of processes that have ended."""
    for folder in base.iterdir():
        with suppress(OSError, msgspec.MsgspecError):
            owner = msgspec.json.decode((folder / _OWNER).read_bytes(), type=ProcessIdentity)
            if process_identity.has_ended(owner):
                _remove(folder)


def _remove(folder: Path) -> None:
    """Remove a private folder by whole paths, which a restricted process checks."""
    with suppress(OSError):
        for parent, folders, files in os.walk(folder, topdown=False):
            for name in files:
                os.unlink(os.path.join(parent, name))
            for name in folders:
                os.rmdir(os.path.join(parent, name))
        os.rmdir(folder)
