"""Refuse files outside the folder of the data set that names them."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from s2rstore.errors import RequestError, shortened


class PathContainment:
    """Resolves the file names of a data set and counts the files outside its folder, by folder.

    A name that is absolute, contains `..` or leads out through a symbolic link is refused unless
    `allowed`: otherwise the author of the data would choose which of the user's files are copied
    into the store.
    """

    def __init__(self, folder: Path, allowed: bool = False) -> None:
        self.folder = folder
        self.allowed = allowed
        self.outside_folders: dict[str, int] = {}
        self._root = os.path.realpath(folder)
        self._real_folders: dict[str, str] = {}

    def for_folder(self, folder: Path) -> PathContainment:
        """A containment check for another folder; both share `outside_folders`."""
        other = PathContainment(folder, self.allowed)
        other.outside_folders = self.outside_folders
        return other

    def resolve(self, name: str, where: str) -> Path:
        """The path of a named file. Raises RequestError, beginning with `where`."""
        path = self.folder / name
        if not _is_possible(path):
            raise RequestError(f"{where}: {shortened(name)!r} is not a file name")
        if os.path.isabs(name) or ".." in Path(name).parts:
            shown = shortened(name)
            refusal = f"{where}: {shown!r}: write it relative to this folder, without `..`"
            return self._admit(path, refusal)
        return self.check(path, where)

    def find_file(self, name: str, where: str) -> Path | None:
        """The path of a named file that exists; None without it, or if no file can have the name.

        Raises RequestError, beginning with `where`, if the name leads out of the folder.
        """
        if not _is_possible(self.folder / name):
            return None
        path = self.resolve(name, where)
        return path if os.path.isfile(path) else None

    def check(self, path: Path, where: str) -> Path:
        """The path, if it lies inside after resolving links. Raises RequestError otherwise."""
        if self._is_within(path):
            return path
        name = shortened(os.path.relpath(path, self.folder))
        return self._admit(path, f"{where}: {name!r}: a symbolic link leads out of this folder")

    def _admit(self, path: Path, refusal: str) -> Path:
        if not self.allowed:
            raise RequestError(f"{refusal}; --allow-outside reads it nevertheless")
        if os.path.exists(path) and not self._is_within(path):
            folder = os.path.dirname(os.path.realpath(path))
            self.outside_folders[folder] = self.outside_folders.get(folder, 0) + 1
        return path

    def _is_within(self, path: Path) -> bool:
        folder, name = os.path.split(path)
        if folder not in self._real_folders:
            self._real_folders[folder] = os.path.realpath(folder)
        real = os.path.join(self._real_folders[folder], name)
        if name in ("", ".", "..") or os.path.islink(real):
            real = os.path.realpath(real)
        return real == self._root or real.startswith(os.path.join(self._root, ""))


def _is_possible(path: Path) -> bool:
    """Whether the file system allows the path: no NUL character, no name that is too long."""
    try:
        os.lstat(path)
    except OSError as error:
        return error.errno != errno.ENAMETOOLONG
    except ValueError:
        return False
    return True
