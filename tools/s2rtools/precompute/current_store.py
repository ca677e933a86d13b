"""The published generation of a store while runs of it are computed and published."""

from __future__ import annotations

from pathlib import Path

import s2rstore
from s2rstore.reader import Store
from s2rtools.precompute.input_hashes import InputHashes


class CurrentStore:
    """Keeps the published generation open and opens it again when there is a newer one."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._store = s2rstore.open(root)
        self.hashes = InputHashes(self._store)

    def __enter__(self) -> CurrentStore:
        return self

    def __exit__(self, *error: object) -> None:
        self._store.close()

    def get(self) -> Store:
        """The generation that is published now; the store of an earlier call may be closed."""
        if self._store.latest_generation() != self._store.generation:
            self._store.close()
            self._store = s2rstore.open(self.root)
            self.hashes = InputHashes(self._store, self.hashes)
        return self._store
