"""Read files of unknown origin: regular files only, of bounded size.

A pipe or a device would block or never end, and a huge file would exhaust memory; each of them is a
RequestError that names the file.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from s2rstore.errors import RequestError, first_line

T = TypeVar("T")

_LEAST, _MOST = 1 << 16, 1 << 24
"""Bytes that are requested at a time."""
_SPECIAL_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def refuse_special(path: Path, mode: int) -> None:
    """Raise RequestError where a file's mode is that of a folder, a pipe, a socket or a device."""
    for is_kind, kind in _SPECIAL_KINDS:
        if is_kind(mode):
            raise RequestError(f"{path}: {kind}, not a regular file")


def check_regular(path: Path) -> os.stat_result:
    """The file's status. Raises RequestError where it is missing or no regular file."""
    try:
        status = path.stat()
    except (OSError, ValueError) as error:
        raise RequestError(f"{path}: cannot be read ({reason_of(error)})") from error
    refuse_special(path, status.st_mode)
    return status


@contextmanager
def open_regular(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file for reading, without waiting for a pipe's other end."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        if path.exists():
            refuse_special(path, path.stat().st_mode)
        raise RequestError(f"{path}: cannot be read ({reason_of(error)})") from error
    try:
        refuse_special(path, os.fstat(descriptor).st_mode)
        file = os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise
    with file:
        try:
            yield file
        except OSError as error:
            raise RequestError(f"{path}: cannot be read ({reason_of(error)})") from error


def read_bytes(path: Path, limit: int) -> bytes:
    """Read a regular file of at most `limit` bytes; RequestError for anything else."""
    with open_regular(path) as file:
        return content_of(file, path, limit)


def content_of(file: io.BufferedIOBase | io.FileIO, path: Path, limit: int) -> bytes:
    """The content of an open file; RequestError where it has more than `limit` bytes."""
    size = os.fstat(file.fileno()).st_size
    if size > limit:
        raise RequestError(f"{path}: {size:,} bytes; at most {limit:,} are read")
    content = bytearray()
    while block := file.read(
        min(max(size - len(content), _LEAST), _MOST, limit - len(content)) + 1
    ):
        content += block
        if len(content) > limit:
            raise RequestError(f"{path}: more than {limit:,} bytes, the limit")
    return bytes(content)


def read_text(path: Path, limit: int) -> str:
    """The text of a UTF-8 file; a byte order mark is dropped."""
    try:
        return read_bytes(path, limit).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RequestError(f"{path}: not UTF-8 at byte {error.start}; save it as UTF-8") from error


def stamp(path: Path) -> tuple[int, int, int] | None:
    """A value that changes when a file is replaced; None where it is missing."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size


def sha256(path: Path) -> str:
    """SHA-256 of a regular file of any size."""
    with open_regular(path) as file:
        return digest(file)


def digest(file: io.BufferedIOBase | io.FileIO) -> str:
    """SHA-256 of an open file's content, in hexadecimal."""
    return hashlib.file_digest(file, "sha256").hexdigest()


def reason_of(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return first_line(error)[:200]
