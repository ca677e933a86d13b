"""The analysis store: `s2rstore.open(path)` gives the published generation of a store."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from s2rstore.interactive_store import InteractiveStore

__all__ = ["open"]


def open(path: str | Path, memory: str = "", generation: int | None = None) -> InteractiveStore:
    """Open the store at `path` for reading; it stays at one generation until closed.

    By default the published one; `generation` opens an earlier one that `s2r prune` has left.
    `memory` (such as 128MB) limits the memory of the index. Raises
    `s2rstore.errors.RequestError` where there is no readable store.
    """
    from s2rstore.interactive_store import InteractiveStore

    return InteractiveStore(path, memory, generation)
