"""Copies of files of remote stores, in the user's cache: `$XDG_CACHE_HOME/s2rtui/remote`.

DuckDB and image libraries open files by their paths. A folder holds the files of one generation of
one URL at the places that they have in the store; its name states the SHA-256 of the index. A file
whose checksum is known is never taken from the cache or from the server without comparing it.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from s2rstore.errors import DamagedStoreError, RequestError
from s2rstore.files import atomic_writes, input_files, user_cache

NAME = "remote"
KEPT_GENERATIONS = 4
"""Generations of one URL that stay in the cache."""
KEPT_DAYS = 30.0
"""Days without use after which the copies of a URL are removed."""

MAX_BYTES = 1 << 30
"""Bytes of a file whose size nothing states."""
_IN_USE_DAYS = 1.0
_DAY = 86_400.0
_SPARE_BYTES = 64 << 20

_SHA256 = re.compile(r"[0-9a-f]{64}\Z")

Fetch = Callable[[str], Iterable[bytes]]
"""Gives the content of a file of the store in blocks."""


class LocalCopies:
    """The copies of one generation of a store."""

    def __init__(self, url: str, fetch: Fetch) -> None:
        self._url = url
        self._fetch = fetch
        self._folder = (
            user_cache.private_folder(NAME) / hashlib.sha256(url.encode()).hexdigest()[:32]
        )
        self._generation: Path | None = None
        self._checked: set[Path] = set()

    def index(self, relative: str, sha256: str | None, size: int | None) -> Path:
        """The copy of an index, whose generation is used from now on.

        An index of an earlier generation has no checksum here and must have been copied before.
        """
        stem = Path(relative).stem
        if sha256 is not None and not _SHA256.match(sha256):
            raise RequestError(f"{self._url}: CURRENT.json states no SHA-256 of {stem}; restore it")
        if sha256 is None:
            known = [p for p in self._folders() if p.name.startswith(f"{stem}-")]
            if not known:
                raise RequestError(
                    f"{self._url}: {stem} is not the published generation, and no copy of it is "
                    "in the cache; open the published one"
                )
            self._generation = known[0]
            sha256 = known[0].name.rpartition("-")[2]
        else:
            self._generation = self._folder / f"{stem}-{sha256}"
        path = self.file(relative, sha256, size)
        os.utime(self._generation)
        self._remove_old()
        return path

    def file(self, relative: str, sha256: str | None, size: int | None) -> Path:
        """The copy of a file of the present generation.

        Without a checksum it is copied again. Raises FileNotFoundError where the store has no such
        file, DamagedStoreError where its content is not that of the checksum.
        """
        assert self._generation is not None, "index() names the generation"
        path = self._generation / relative
        if sha256 is not None and (path in self._checked or self._reuse(path, relative, sha256)):
            self._checked.add(path)
            return path
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._require_space(relative, size)
        atomic_writes.write_file(path, self._compared(relative, sha256, size))
        if sha256 is not None:
            self._checked.add(path)
        return path

    def path(self, relative: str) -> Path:
        """Where the copy of a file of the present generation lies, or would lie."""
        assert self._generation is not None, "index() names the generation"
        return self._generation / relative

    def _reuse(self, path: Path, relative: str, sha256: str) -> bool:
        """Whether the file is in the cache, in this generation or, then linked, in another one."""
        others = (folder / relative for folder in self._folders())
        for known in (path, *others):
            with suppress(OSError, RequestError):
                if known.is_file() and input_files.sha256(known) == sha256:
                    if known != path:
                        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                        path.unlink(missing_ok=True)
                        os.link(known, path)
                    return True
        return False

    def _compared(self, relative: str, sha256: str | None, size: int | None) -> Iterator[bytes]:
        """The content of a file; fails at its end where size or checksum are not as stated."""
        where, digest, count = f"{self._url}/{relative}", hashlib.sha256(), 0
        for block in self._fetch(relative):
            count += len(block)
            if count > (MAX_BYTES if size is None else size):
                break
            digest.update(block)
            yield block
        if size is None and count > MAX_BYTES:
            raise RequestError(f"{where}: more than {MAX_BYTES} bytes; they are not read")
        if size is not None and count != size:
            found = "more" if count > size else str(count)
            message = f"{where}: {found} bytes instead of the published {size}; run `s2r verify`"
            raise DamagedStoreError(message)
        if sha256 is not None and digest.hexdigest() != sha256:
            message = f"{where}: its checksum is not the published one; run `s2r verify`"
            raise DamagedStoreError(message)

    def _require_space(self, relative: str, size: int | None) -> None:
        free = shutil.disk_usage(self._folder).free
        if size is not None and size + _SPARE_BYTES > free:
            raise RequestError(
                f"{self._url}/{relative}: {size} bytes do not fit into {self._folder}; free space, "
                "or set XDG_CACHE_HOME"
            )

    def _folders(self) -> list[Path]:
        """The generations of this URL, the one that was used last first."""
        used: list[tuple[float, Path]] = []
        with suppress(FileNotFoundError):
            for folder in self._folder.iterdir():
                with suppress(FileNotFoundError):  # removed by another process
                    used.append((folder.stat().st_mtime, folder))
        return [folder for _, folder in sorted(used, reverse=True)]

    def _remove_old(self) -> None:
        """Remove what has not been used for long; files that a process has open stay readable."""
        now = time.time()
        for folder in self._folders()[KEPT_GENERATIONS:]:
            _remove_unused(folder, now - _IN_USE_DAYS * _DAY)
        with suppress(OSError):
            os.utime(self._folder)
            for folder in self._folder.parent.iterdir():
                _remove_unused(folder, now - KEPT_DAYS * _DAY)


def _remove_unused(folder: Path, since: float) -> None:
    with suppress(OSError):
        if folder.stat().st_mtime < since:
            shutil.rmtree(folder, ignore_errors=True)
