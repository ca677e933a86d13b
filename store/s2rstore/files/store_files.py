"""The files of a store, read by their paths below its root, wherever the store is kept.

Readers use this interface only. `LocalFiles` are those of a folder; `s2rstore.remote` has those of
an object store or a web server. A missing file is a FileNotFoundError, a file that must not be read
is a RequestError; both name the file in full.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from io import BufferedIOBase, BufferedReader, FileIO
from pathlib import Path
from typing import Protocol

from s2rstore.files import input_files, safe_files
from s2rstore.files.safe_files import FolderEntry, Kind

Stamp = tuple[int, int, int]
"""A value that differs for every content that a file ever has."""


class OpenFile(Protocol):
    """A file that is read in pieces, from any offset."""

    def tail(self, length: int) -> tuple[bytes, int]:
        """The last `length` bytes, fewer in a shorter file, and the size of the file in bytes."""
        ...

    def piece(self, offset: int, length: int) -> bytes:
        """`length` bytes from `offset` on, fewer at the end of the file."""
        ...


class StoreFiles(ABC):
    """The files of one store. `path` names the store in messages and opens it again.

    `is_remote`: every access may take seconds, so the application makes none while it draws.
    """

    path: Path
    is_remote = False

    @property
    def lists_files(self) -> bool:
        """Whether `names` and `walk` know the content of folders."""
        return True

    @property
    @abstractmethod
    def absence(self) -> str:
        """Why there is no store and what to do, for a message."""

    @abstractmethod
    def open(self, relative: str) -> AbstractContextManager[OpenFile]:
        """A file that is read in pieces."""

    @abstractmethod
    def stream(self, relative: str) -> BufferedIOBase:
        """A file that is read from its beginning."""

    @abstractmethod
    def read(self, relative: str, limit: int) -> bytes:
        """The content of a file; RequestError where it has more than `limit` bytes."""

    @abstractmethod
    def size(self, relative: str) -> int:
        """Bytes of a file."""

    @abstractmethod
    def kind(self, relative: str) -> Kind | None:
        """The kind of a path; None for a missing one."""

    @abstractmethod
    def names(self, relative: str) -> list[FolderEntry]:
        """The entries of a folder, by name; none where there is no such folder."""

    @abstractmethod
    def walk(self, relative: str = "") -> Iterator[FolderEntry]:
        """All entries below a folder."""

    @abstractmethod
    def stamp(self, relative: str) -> Stamp | None:
        """A value that changes whenever a file is replaced; None for a missing file."""

    @abstractmethod
    def index_file(self, relative: str, sha256: str | None, size: int | None) -> Path:
        """The path of an index in a folder of this machine.

        `sha256` and `size` are those that `CURRENT.json` states; None for an earlier generation.
        """

    @abstractmethod
    def local_file(self, relative: str, sha256: str | None = None, size: int | None = None) -> Path:
        """The path of a file in a folder of this machine, for libraries that open paths.

        Files of one store keep their places relative to each other. A missing file is left to
        whoever opens it.
        """

    def forget_pieces(self) -> None:  # noqa: B027 - most stores keep none
        """Drop what is kept in memory of files that were read."""

    def sha256(self, relative: str) -> str:
        """SHA-256 of a file, in hexadecimal."""
        with self.stream(relative) as file:
            return input_files.digest(file)


class _OpenLocalFile:
    def __init__(self, file: FileIO) -> None:
        self._descriptor = file.fileno()

    def tail(self, length: int) -> tuple[bytes, int]:
        size = os.fstat(self._descriptor).st_size
        return os.pread(self._descriptor, length, max(size - length, 0)), size

    def piece(self, offset: int, length: int) -> bytes:
        return os.pread(self._descriptor, length, offset)


class LocalFiles(StoreFiles):
    """The files of a folder, read without following links below it."""

    def __init__(self, root: Path) -> None:
        self.path = root

    @property
    def absence(self) -> str:
        reason = "no CURRENT.json in it" if self.path.is_dir() else "no such folder"
        reason = "a file, no folder" if self.path.is_file() else reason
        return f"not a store ({reason}); make one with `s2r ingest`"

    @contextmanager
    def open(self, relative: str) -> Iterator[OpenFile]:
        with safe_files.open_read(self.path, relative) as file:
            yield _OpenLocalFile(file)

    def stream(self, relative: str) -> BufferedIOBase:
        return BufferedReader(safe_files.open_read(self.path, relative))

    def read(self, relative: str, limit: int) -> bytes:
        return safe_files.read(self.path, relative, limit)

    def size(self, relative: str) -> int:
        return safe_files.size(self.path, relative)

    def kind(self, relative: str) -> Kind | None:
        return safe_files.kind(self.path, relative)

    def names(self, relative: str) -> list[FolderEntry]:
        return safe_files.names(self.path, relative)

    def walk(self, relative: str = "") -> Iterator[FolderEntry]:
        return safe_files.walk(self.path, relative)

    def stamp(self, relative: str) -> Stamp | None:
        return input_files.stamp(self.path / relative)

    def index_file(self, relative: str, sha256: str | None, size: int | None) -> Path:
        return safe_files.checked_path(self.path, relative)

    def local_file(self, relative: str, sha256: str | None = None, size: int | None = None) -> Path:
        return safe_files.checked_path(self.path, relative)

    def sha256(self, relative: str) -> str:
        return safe_files.sha256(self.path, relative)
