"""Operations on a lock file, in a store or beside a file, each atomic in its folder.

A store may come from somebody else and be shared, so the content of a lock file is never trusted:
links are not followed, only regular files are opened, and at most `SIZE` bytes are read.
"""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from s2rstore.files import safe_files

SIZE = 1024
"""Bytes of a lock file, and the most that are read of any."""
_GONE = (errno.ENOENT, errno.ESTALE)


class Found(NamedTuple):
    """The content of a lock file, and when it was modified, in nanoseconds since 1970.

    `modified` is by the clock of the file system. It is compared with other values of the same
    file only.
    """

    content: bytes
    modified: int


class LockFile:
    """A lock file. Below `root` no link is followed; without `root` the folder may be a link."""

    def __init__(self, path: Path, root: Path | None = None) -> None:
        self.path = path
        self._root = root

    def beside(self, name: str) -> LockFile:
        """Another file in the same folder, which `s2r prune` takes for an unfinished one."""
        return LockFile(self.path.with_name(f"{self.path.name}.{name}.partial"), self._root)

    def create(self, content: bytes) -> bool:
        """Make the file with this content; False where it exists already.

        The content is read again, for file systems that let two hosts create one file: the last
        writer has it. Raises OSError, and RequestError for a link.
        """
        with self._folder(create=True) as folder:
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL
            try:
                descriptor = safe_files.open_regular_at(self.path, flags, folder)
            except FileExistsError:
                return False
            try:
                with safe_files.errors_of(self.path), os.fdopen(descriptor, "wb") as file:
                    file.write(content)
            except BaseException:
                with suppress(OSError):
                    os.unlink(self._name(folder), dir_fd=folder)
                raise
        found = self.read()
        return found is not None and found.content == content

    def read(self) -> Found | None:
        """The present content; None where there is no such file.

        Raises OSError, and RequestError for anything but a regular file.
        """
        with self._opened(os.O_RDONLY) as descriptor:
            if descriptor is None:
                return None
            return Found(os.pread(descriptor, SIZE, 0), os.fstat(descriptor).st_mtime_ns)

    def rewrite(self, is_own: Callable[[bytes], bool], content: bytes) -> bool:
        """Replace the content by one of the same size, if `is_own` accepts the present one.

        Returns False, and changes nothing, where it does not or the file is gone.
        """
        with self._opened(os.O_RDWR) as descriptor:
            if descriptor is None or not is_own(os.pread(descriptor, SIZE, 0)):
                return False
            os.pwrite(descriptor, content, 0)
            return True

    def remove(self) -> None:
        """Remove the file; one that is gone already is no error."""
        with self._folder() as folder, suppress(FileNotFoundError):
            os.unlink(self._name(folder), dir_fd=folder)

    def remove_content(self, content: bytes) -> bool:
        """Remove the file if it has this content; False where it has not, or is gone.

        The file is renamed to a unique name first and compared there: nobody replaces it between
        the comparison and the removal. A file with other content gets its name back, unless that
        is in use again.
        """
        aside = self.beside(secrets.token_hex(8))
        with self._folder() as folder:
            names = self._name(folder), aside._name(folder)
            try:
                os.rename(*names, src_dir_fd=folder, dst_dir_fd=folder)
            except FileNotFoundError:
                return False
            found = aside.read()
            is_same = found is not None and found.content == content
            if not is_same:
                with suppress(OSError):  # in use again, or a file system without hard links
                    os.link(names[1], names[0], src_dir_fd=folder, dst_dir_fd=folder,
                            follow_symlinks=False)  # fmt: skip
            with suppress(FileNotFoundError):
                os.unlink(names[1], dir_fd=folder)
            return is_same

    def _name(self, folder: int | None) -> str:
        return str(self.path) if folder is None else self.path.name

    @contextmanager
    def _folder(self, create: bool = False) -> Iterator[int | None]:
        """A descriptor of the folder; None, so that whole paths are used, outside a store.

        A restricted process checks whole paths.
        """
        if self._root is None:
            with safe_files.errors_of(self.path):
                yield None
            return
        relative = self.path.parent.relative_to(self._root)
        with (
            safe_files.folder(self._root, relative, create) as descriptor,
            safe_files.errors_of(self.path),
        ):
            yield descriptor

    @contextmanager
    def _opened(self, flags: int) -> Iterator[int | None]:
        """A descriptor of the file; None where it is gone."""
        descriptor = None
        try:
            with self._folder() as folder:
                descriptor = safe_files.open_regular_at(self.path, flags, folder)
        except OSError as error:
            if error.errno not in _GONE:
                raise
        try:
            with safe_files.errors_of(self.path):
                yield descriptor
        finally:
            if descriptor is not None:
                os.close(descriptor)
