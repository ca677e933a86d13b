"""Permissions of a session: writing files and loading models."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from s2rstore.errors import RequestError
from s2rtui.user_data import user_data_dir

Capability = Literal["", "models"]
"""A right beyond reading the store and writing in the user data folder."""


@dataclass(frozen=True, slots=True)
class Permissions:
    """A store, the user data folder, and whether the session is restricted to these two.

    A restricted session loads no model, changes no store and writes only in `user_data_dir`.
    """

    store: Path
    user_data_dir: Path
    restricted: bool = False

    @classmethod
    def for_store(cls, store: Path, restricted: bool = False) -> Permissions:
        """Return the permissions of this user; a restricted session creates its folder."""
        folder = user_data_dir().absolute()
        if restricted:
            with suppress(OSError):
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return cls(store.absolute(), folder, restricted)

    def allows(self, capability: Capability) -> bool:
        """Whether an action that needs a capability is offered."""
        return capability != "models" or not self.restricted

    def may_write(self, path: Path) -> bool:
        """Whether a path may be written."""
        return not self.restricted or path.resolve().is_relative_to(self.user_data_dir.resolve())

    @property
    def output_dir(self) -> Path:
        """The folder for screenshots and exports without a folder in their name."""
        return self.user_data_dir if self.restricted else Path.cwd()

    def require_writable(self, path: Path) -> Path:
        """Return `path`. Raises RequestError if it may not be written."""
        if not self.may_write(path):
            folder = self.user_data_dir
            raise RequestError(f"{path}: a restricted session can write only in {folder}")
        return path
