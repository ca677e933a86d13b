"""What a session may do: whoever writes, takes a path or loads a model asks here first."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from s2rstore.errors import RequestError
from s2rtui.user_data.folder import own_folder

# What an action needs beyond reading the store and writing in the user's own folder.
Need = Literal["", "models"]


@dataclass(frozen=True, slots=True)
class Permissions:
    """A store, the user's own folder, and whether the session is confined to these two.

    A restricted session loads no model, changes no store and writes in `own` alone.
    """

    store: Path
    own: Path
    restricted: bool = False

    @classmethod
    def of(cls, store: Path, restricted: bool = False) -> Permissions:
        """Of this user on `store`; makes the own folder of a restricted session where it can."""
        own = own_folder().absolute()
        if restricted:
            with suppress(OSError):
                own.mkdir(mode=0o700, parents=True, exist_ok=True)
        return cls(store.absolute(), own, restricted)

    @property
    def may_adjust(self) -> bool:
        """Whether a model may be loaded, and a run of it registered and computed."""
        return not self.restricted

    def grants(self, need: Need) -> bool:
        """Whether what an action needs is allowed: those that lack it are not offered."""
        return need != "models" or self.may_adjust

    def may_write(self, path: Path) -> bool:
        return not self.restricted or _inside(path, self.own)

    @property
    def pictures(self) -> Path:
        """The folder that snapshots and exports without a name go to."""
        return self.own if self.restricted else Path.cwd()

    def writable(self, path: Path) -> Path:
        """`path`, or RequestError where it may not be written."""
        if not self.may_write(path):
            raise RequestError(f"{path}: a restricted session writes in {self.own} only")
        return path


def _inside(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
