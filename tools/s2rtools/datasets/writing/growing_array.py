"""Arrays whose shards are written as their rows come; the metadata is written last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Generic, TypeVar

from s2rstore.arrays import array_writer
from s2rstore.arrays.stored_array import shard_name
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.files.ledger import LedgerEntry
from s2rtools.datasets.writing.ingest_journal import SHARD_ROWS, Shard

Row = TypeVar("Row")

Plan = Callable[[int, tuple[int, ...], str], Layout]
"""The layout of an array of so many rows of a shape and a numpy type."""
Encode = Callable[[Layout, Sequence[Row]], Sequence[bytes]]
"""The compressed chunks of the rows of a shard."""


class GrowingArray(Generic[Row]):
    """An array in `folder` inside `root`; `plan` and `encode` say how rows become chunks."""

    def __init__(self, root: Path, folder: str, plan: Plan, encode: Encode[Row]) -> None:
        self.folder = folder
        self._root, self._plan, self._encode = root, plan, encode
        self._rows: list[Row] = []
        self._count = 0
        self._entries: list[LedgerEntry] = []

    def add(self, row: Row, shape: tuple[int, ...], dtype: str) -> None:
        """Add a row, and write a shard that it completes."""
        self._item = shape, dtype
        self._rows.append(row)
        self._count += 1
        if len(self._rows) == SHARD_ROWS:
            self.flush()

    def take(self, shard: Shard, rows: int) -> None:
        """Count a file that an interrupted ingest has written as the next shard."""
        self._item, self._count = (shard.item, shard.dtype), self._count + rows
        name = f"{self.folder}/{shard_name(self._layout, len(self._entries))}"
        self._entries.append(LedgerEntry("", name, shard.bytes, shard.sha256, rows))

    @property
    def last_shard(self) -> Shard:
        """The shard that was written last."""
        entry = self._entries[-1]
        return Shard(*self._item, entry.bytes, entry.checksum)

    @property
    def is_empty(self) -> bool:
        """Whether it has no row yet."""
        return self._count == 0

    def flush(self) -> None:
        """Write the rows that no shard has yet."""
        if not self._rows:
            return
        rows, self._rows = self._rows, []
        chunks, shard = self._encode(self._layout, rows), len(self._entries)
        file = array_writer.write_chunks(
            self._root, self.folder, self._layout, shard, len(rows), chunks
        )
        self._entries.append(LedgerEntry("", file.path, file.bytes, file.sha256, len(rows)))

    def finish(self) -> list[LedgerEntry]:
        """Write the last shard and the metadata; gives the entries of the shards, without keys."""
        self.flush()
        if self._entries:
            array_writer.create(self._root / self.folder, self._layout, root=self._root)
        return self._entries

    @property
    def _layout(self) -> Layout:
        return self._plan(self._count, *self._item)
