"""Operations on a lock file, in a store or beside a file, each atomic in its folder.

A store may come from somebody else and be shared, so the content of a lock file is never trusted:
links are not followed, only regular files are opened, and at most `lease.SIZE` bytes are read.
"""

from __future__ import annotations

import errno
import fcntl
import os
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from s2rstore.files import safe_files
from s2rstore.files.atomic_writes import PARTIAL
from s2rstore.files.lease import SIZE, Found

_TRIES, _PAUSE = 500, 0.01
_GONE = (errno.ENOENT, errno.ESTALE)


class LockFile:
    """A `LeasePlace`. Below `root` no link is followed; without `root` the folder may be a link."""

    def __init__(self, path: Path, root: Path | None = None) -> None:
        self.path = path
        self._root = root

    def swap(self, found: Found | None, content: bytes | None) -> bool:
        """See `LeasePlace`. Raises OSError, and RequestError for anything but a regular file."""
        with self._folder(create=True) as folder, self._alone(folder):
            if found is not None and not self._remove(found.content):
                return False
            return content is None or self._create(content)

    @contextmanager
    def _alone(self, folder: int | None) -> Iterator[None]:
        """Keep other processes of this host out of `swap`, for some seconds where one hangs in it.

        Those of other hosts are kept apart by `O_EXCL` and the comparison of contents alone.
        """
        path = str(self.path.parent) if folder is None else "."
        flags = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
        descriptor = os.open(path, flags, dir_fd=folder)
        try:
            for _ in range(_TRIES):
                try:
                    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    time.sleep(_PAUSE)
                except OSError:  # not on this file system
                    break
            yield
        finally:
            os.close(descriptor)

    def _create(self, content: bytes) -> bool:
        """Make the file; False where it exists already.

        The content is read again, for file systems that let two hosts create one file: the last
        writer has it. Another process may have moved it away meanwhile, to compare it.
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
        return found is None or found.content == content

    def read(self) -> Found | None:
        """See `LeasePlace`. Raises OSError, and RequestError for anything but a regular file."""
        with self._opened(os.O_RDONLY) as descriptor:
            if descriptor is None:
                return None
            return Found(os.pread(descriptor, SIZE, 0), os.fstat(descriptor).st_mtime_ns)

    def renew(self, is_own: Callable[[bytes], bool], content: bytes) -> bool:
        """See `LeasePlace`. The file is written in place, for which a full disk has room."""
        with self._opened(os.O_RDWR) as descriptor:
            if descriptor is None or not is_own(os.pread(descriptor, SIZE, 0)):
                return False
            os.pwrite(descriptor, content, 0)
            return True

    def _remove(self, content: bytes) -> bool:
        """Remove the file if it has this content; False where it has not, or is gone.

        A file that seems to have it is renamed to a unique name and compared there: nobody
        replaces it between this comparison and the removal. One with other content gets its name
        back, unless that is in use again.
        """
        present = self.read()
        if present is None or present.content != content:
            return False
        aside = self.path.with_name(f"{self.path.name}.{secrets.token_hex(8)}{PARTIAL}")
        moved = LockFile(aside, self._root)
        with self._folder() as folder:
            names = self._name(folder), moved._name(folder)
            try:
                os.rename(*names, src_dir_fd=folder, dst_dir_fd=folder)
            except FileNotFoundError:
                return False
            found = moved.read()
            is_same = found is not None and found.content == content
            if found is not None and not is_same:
                try:
                    os.link(*names[::-1], src_dir_fd=folder, dst_dir_fd=folder,
                            follow_symlinks=False)  # fmt: skip
                except OSError:  # in use again, or a file system without hard links
                    with suppress(OSError):
                        self._create(found.content)
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
