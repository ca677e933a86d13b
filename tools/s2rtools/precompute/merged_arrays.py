"""Write the arrays of segments from those of their parts, without computing values again.

Whole shards get a second name in the merged array (a hard link), and whole chunks are copied as
they are; only chunks with rows of two arrays are compressed again. A shard counts when the ledger
records it, so that an interrupted merge goes on with the next shard. Arrays that are read are
compared with the ledger first: a merge gives no checksum to damaged values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from s2rstore.arrays import array_writer
from s2rstore.arrays.row_array import PartedArray
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rstore.geometry.map_grid import AGGREGATES, merged_aggregate
from s2rtools.common.processors import available_processors
from s2rtools.precompute.segment_plan import ArrayMerge

_BLOCK_BYTES = 16 * 2**20

Entries = Mapping[str, Sequence[LedgerEntry]]


@dataclass(frozen=True, slots=True)
class _Source:
    """An array that holds the rows [`start`, `stop`) of a merged one.

    Those of aggregates hold no rows of it. `entries` are those of its files in the ledger.
    """

    array: StoredArray
    start: int
    entries: Entries

    @property
    def stop(self) -> int:
        return self.start + self.array.shape[0]

    def shards(self, first: int, stop: int) -> range:
        """The shards with some of the rows [first, stop) of the merged array."""
        size = self.array.layout.shard_rows
        low, high = max(first, self.start) - self.start, min(stop, self.stop) - self.start
        return range(low // size, -(-high // size)) if low < high else range(0)

    def whole_shard(self, layout: Layout, shard: int) -> int | None:
        """Which shard is shard number `shard` of a merged array of this layout; None for none."""
        mine, first = self.array.layout, shard * layout.shard_rows
        number, offset = divmod(first - self.start, mine.shard_rows)
        is_alike = (mine.shard_rows, mine.rows_per_chunk) == (
            layout.shard_rows,
            layout.rows_per_chunk,
        )
        is_inside = self.start <= first and first + layout.shard_rows <= self.stop
        return number if is_alike and is_inside and not offset else None

    def whole_chunks(self, layout: Layout, first: int, stop: int) -> range:
        """Those of the rows [first, stop) whose chunks are the same in a merged array."""
        size = layout.rows_per_chunk
        if self.start % size or self.array.layout.rows_per_chunk != size:
            return range(0)
        end = self.stop - self.array.shape[0] % size
        return range(max(first, self.start), min(stop, end))


def merge_arrays(
    root: Path,
    run: str,
    merges: Sequence[ArrayMerge],
    check: Callable[[], None] = lambda: None,
    advance: Callable[[int], None] = lambda arrays: None,
) -> None:
    """Write and record the merged arrays of a run; `advance` is called after each of them.

    `check` is called before files are recorded. Raises RequestError where the ledger does not prove
    a file that is read.
    """
    entries_of = cache(Ledger(root).array_entries)
    with ThreadPoolExecutor(available_processors()) as pool:
        for merge in merges:
            _Merging(root, run, merge, entries_of).write(pool, check)
            advance(1)


class _Merging:
    """Writes one merged array."""

    def __init__(
        self, root: Path, run: str, merge: ArrayMerge, entries_of: Callable[[str], Entries]
    ) -> None:
        self._root, self._run, self._merge = root, run, merge
        self._ledger = Ledger(root)
        self._array = merge.stage.create(root, merge.spec)
        self._recorded = entries_of(merge.spec.folder(run))
        self._sources = [
            _Source(
                each.open_array(root, run),
                each.first_iid - merge.spec.first_iid,
                entries_of(each.folder(run)),
            )
            for each in merge.sources
        ]
        self._proven: set[str] = set()

    def write(self, pool: ThreadPoolExecutor, check: Callable[[], None]) -> None:
        """Link or write the shards that the ledger does not record."""
        missing = [
            shard for shard in range(self._array.layout.shards)
            if not self._entries(self._recorded, self._array.file(shard))
        ]  # fmt: skip
        linked = {shard: self._link(shard) for shard in missing}
        entries = [entry for of_shard in linked.values() for entry in of_shard]
        if entries:
            atomic_writes.sync(self._root, entries[-1].path)
            self._record(entries, check)
        for written in pool.map(self._write, (shard for shard in missing if not linked[shard])):
            self._record(written, check)

    def _record(self, entries: Sequence[LedgerEntry], check: Callable[[], None]) -> None:
        check()
        self._ledger.add_array_entries(self._merge.spec.folder(self._run), entries)

    def _entries(self, entries: Entries, name: str) -> list[LedgerEntry]:
        """Those of the entries of a file that state its size."""
        return [entry for entry in entries.get(name, ()) if self._ledger.states_size([entry])]

    def _link(self, shard: int) -> list[LedgerEntry]:
        """Give a whole shard of a source a second name; no entries where there is none."""
        if self._merge.stage.is_aggregate:
            return []
        name = self._array.file(shard)
        for source in self._sources:
            number = source.whole_shard(self._array.layout, shard)
            if number is not None:
                old = source.array.file(number)
                entries = self._entries(source.entries, old)
                try:
                    atomic_writes.link(self._root, old, name)
                except OSError:  # the file system has no hard links: it is copied
                    return []
                return [msgspec.structs.replace(entry, path=name) for entry in entries]
        return []

    def _write(self, shard: int) -> list[LedgerEntry]:
        """Write a shard from the rows of its sources; gives an entry for each environment."""
        layout, count = self._array.layout, self._array.rows_in(shard)
        first = shard * layout.shard_rows
        used = {
            msgspec.json.encode(entry.environment): entry.environment
            for entry in self._prove(first, first + count)
        }
        is_aggregate = self._merge.stage.is_aggregate
        chunks = self._grids() if is_aggregate else self._chunks(first, first + count)
        folder = self._array.path.relative_to(self._root).as_posix()
        file = array_writer.write_chunks(self._root, folder, layout, shard, count, chunks)
        unit = f"{self._run}:{self._merge.stage.name}:{shard}"
        return [
            LedgerEntry(unit, file.path, file.bytes, file.sha256, count, environment)
            for environment in used.values()
        ]

    def _prove(self, first: int, stop: int) -> Iterator[LedgerEntry]:
        """The entries of the files with some of the rows [first, stop), which are compared."""
        for source in self._sources:
            shards = range(1) if self._merge.stage.is_aggregate else source.shards(first, stop)
            for name in map(source.array.file, shards):
                entries = self._entries(source.entries, name)
                if name not in self._proven and not self._ledger.proves(entries):
                    raise RequestError(
                        f"{self._root / name}: its checksum is not the ledger's; remove it, and "
                        "run `s2r precompute`"
                    )
                self._proven.add(name)
                yield from entries

    def _chunks(self, first: int, stop: int) -> Iterator[bytes]:
        """The compressed chunks of the rows [first, stop), which begin with a chunk."""
        layout, position = self._array.layout, first
        for source in self._sources:
            rows = source.whole_chunks(layout, first, stop)
            if rows:
                yield from self._encoded(position, rows.start)
                begin, end = rows.start - source.start, rows.stop - source.start
                size = layout.rows_per_chunk
                yield from source.array.chunks(begin // size, end // size)
                position = rows.stop
        yield from self._encoded(position, stop)

    def _encoded(self, first: int, stop: int) -> Iterator[bytes]:
        """The rows [first, stop) of all sources, compressed again."""
        layout = self._array.layout
        parts = [(source.start, source.array) for source in self._sources]
        rows = PartedArray(parts, self._array.shape[0], f"run {self._run!r}: {self._array.path}")
        block = max(1, _BLOCK_BYTES // layout.chunk_bytes) * layout.rows_per_chunk
        for start in range(first, stop, block):
            yield from array_writer.encode_chunks(
                layout, rows.rows(start, min(start + block, stop))
            )

    def _grids(self) -> list[bytes]:
        """The map grids of all sources, merged."""
        grids = [
            dict(zip(AGGREGATES, np.asarray(source.array[:], dtype=np.float32), strict=True))
            for source in self._sources
        ]
        merged = np.stack([merged_aggregate(grids, aggregate) for aggregate in AGGREGATES])
        return array_writer.encode_chunks(self._array.layout, merged)
