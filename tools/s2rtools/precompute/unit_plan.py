"""Which units of stages are to be computed, and the shards that their results complete."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, safe_files
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rstore.geometry.map_grid import TOTALS
from s2rtools.precompute import unit_results
from s2rtools.precompute.unit_results import ChunkSizes, UnitResult, decode_totals
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

Totals = Mapping[ArraySpec, NDArray[np.float64]]
Merge = Callable[[Iterable[Totals]], Mapping[ArraySpec, NDArray[Any]]]


@dataclass(eq=False, slots=True)
class _Shard:
    """A shard that is not complete, and the units that it waits for.

    `path` is that of its array in runs.zarr, `folder` that of the units' results. A unit's chunks
    of it are results of `rows_per_chunk` instances, `chunk_bytes` each before compression.
    """

    stage: Stage
    spec: ArraySpec
    array: StoredArray
    number: int
    units: range
    path: str
    folder: str
    rows_per_chunk: int
    chunk_bytes: int
    waiting: set[int]

    @classmethod
    def of(
        cls, stage: Stage, array: StoredArray, spec: ArraySpec, number: int, units: range
    ) -> Self:
        """A shard whose units are not finished."""
        rows, size = array.layout.rows_per_chunk, array.layout.chunk_bytes
        if stage.is_aggregate:  # the totals of a unit are one chunk
            rows, size = max(1, len(stage.instances)), 8 * len(TOTALS) * math.prod(spec.item)
        path, folder = spec.path(stage.run), unit_results.folder(stage)
        return cls(stage, spec, array, number, units, path, folder, rows, size, set(units))

    @property
    def results(self) -> list[str]:
        """The files of the units' results."""
        return [f"{self.folder}/{number}" for number in self.units]


class UnitPlan:
    """The units of some stages of a run that are to be computed, in order.

    Finished units are passed to `finish`, which writes and records the shards that are complete.
    """

    def __init__(
        self, root: Path, stages: Sequence[Stage], published: Collection[str], merge: Merge
    ) -> None:
        """`published` are paths in runs.zarr of arrays that are complete.

        Of these, only shards whose file is missing are computed; of others, those that the ledger
        does not record. `merge` makes aggregates of the totals of several units, in order. Results
        of an earlier process are used.
        """
        self._root, self._merge = root, merge
        self._ledger = Ledger(root)
        self._results: dict[str, UnitResult] = {}
        self._shards: dict[str, list[_Shard]] = {}
        self._uses: Counter[str] = Counter()
        self._folders: list[str] = []
        self.units: list[WorkUnit] = []
        for stage in stages:
            self._plan(stage, published)

    def _plan(self, stage: Stage, published: Collection[str]) -> None:
        folder = unit_results.folder(stage)
        missing: dict[int, list[_Shard]] = defaultdict(list)
        for spec in stage.specs:
            for shard in self._missing_shards(stage, spec, published):
                for number in shard.units:
                    missing[number].append(shard)
        if missing:
            self._folders.append(folder)
        elif safe_files.kind(self._root, folder) is not None:
            atomic_writes.remove(self._root, folder)
        complete = []
        earlier = {entry.path for entry in safe_files.names(self._root, folder)}
        for number, shards in sorted(missing.items()):
            specs = tuple(dict.fromkeys(shard.spec for shard in shards))
            unit, name = WorkUnit(stage, number, specs), unit_results.file_name(stage, number)
            self._shards[name], self._uses[name] = shards, len(shards)
            expected = self._chunk_sizes(unit)
            result = unit_results.read(self._root, unit, expected) if name in earlier else None
            if result:
                self._results[name] = result
                complete.append(unit)
            else:
                self.units.append(unit)
        for unit in complete:
            self._complete(unit)

    def _missing_shards(
        self, stage: Stage, spec: ArraySpec, published: Collection[str]
    ) -> Iterator[_Shard]:
        array = stage.create(self._root, spec)
        path = spec.path(stage.run)
        entries = {} if path in published else self._entries(spec, stage.run, array)
        files = _file_sizes(self._root, array)
        per_shard, per_unit = array.layout.shard_rows, stage.unit_rows
        for number in range(array.layout.shards):
            name = array.file(number)
            sizes = {entry.bytes for entry in entries.get(name, ())}
            if name in files and (path in published or files[name] in sizes):
                continue
            if stage.is_aggregate:
                units = range(-(-len(stage.instances) // per_unit))
            else:
                if len(stage.instances) > per_unit and per_unit % array.layout.rows_per_chunk:
                    raise RequestError(
                        f"{array.path}: begun by another release; remove it and run the command "
                        "again"
                    )
                stop = number * per_shard + array.rows_in(number)
                units = range(number * per_shard // per_unit, -(-stop // per_unit))
            yield _Shard.of(stage, array, spec, number, units)

    @cached_property
    def _shared_entries(self) -> dict[str, list[LedgerEntry]]:
        return self._ledger.shared_entries()

    def _entries(
        self, spec: ArraySpec, run: str, array: StoredArray
    ) -> dict[str, list[LedgerEntry]]:
        """The ledger's entries of an array; releases up to 0.2.0 wrote them among all others."""
        if not array.layout.is_flat:
            return self._shared_entries
        return self._ledger.array_entries(spec.folder(run))

    def _chunk_sizes(self, unit: WorkUnit) -> dict[str, ChunkSizes]:
        """What the result of a unit holds of its missing arrays, by their paths."""
        name, rows = unit_results.file_name(unit.stage, unit.number), len(unit.instances)
        return {
            shard.path: ChunkSizes(-(-rows // shard.rows_per_chunk), shard.chunk_bytes)
            for shard in self._shards[name]
        }

    def finish(self, unit: WorkUnit) -> None:
        """Use the result of a unit that has been computed."""
        name = unit_results.file_name(unit.stage, unit.number)
        expected = self._chunk_sizes(unit)
        result = unit_results.read(self._root, unit, expected, is_checked=False)
        if result is None:
            raise RequestError(f"{self._root / name}: removed while it was used; run it again")
        self._results[name] = result
        self._complete(unit)

    def close(self) -> None:
        """Remove the folders of the results; all units are finished."""
        for folder in self._folders:
            atomic_writes.remove(self._root, folder)
        for folder in dict.fromkeys(str(Path(folder).parent) for folder in self._folders):
            if not safe_files.names(self._root, folder):
                atomic_writes.remove(self._root, folder)

    def _complete(self, unit: WorkUnit) -> None:
        """Write and record the shards that waited for this unit only, then drop their results."""
        entries: dict[str, list[LedgerEntry]] = defaultdict(list)
        assembled = []
        for shard in self._shards.pop(unit_results.file_name(unit.stage, unit.number)):
            shard.waiting.discard(unit.number)
            if not shard.waiting:
                folder = shard.spec.folder(shard.stage.run)
                entries[folder].append(self._write(shard))
                assembled.append(shard)
        for key, recorded in entries.items():
            self._ledger.add_array_entries(key, recorded)
        for shard in assembled:
            for name in shard.results:
                self._uses[name] -= 1
                if not self._uses[name]:
                    del self._results[name]
                    atomic_writes.remove(self._root, name)

    def _write(self, shard: _Shard) -> LedgerEntry:
        """Write a shard from the results of its units."""
        results = [self._results[name] for name in shard.results]
        with safe_files.folder(self._root, shard.folder) as folder:
            parts = (list(result.chunks(shard.path, folder)) for result in results)
            return self._write_parts(shard, parts)

    def _write_parts(self, shard: _Shard, parts: Iterator[list[bytes]]) -> LedgerEntry:
        """Write a shard from the chunks of its units."""
        if shard.stage.is_aggregate:
            totals = ({shard.spec: decode_totals(part, shard.spec.item)} for part in parts)
            rows = self._merge(totals)[shard.spec]
            chunks: Iterable[bytes] = array_writer.encode_chunks(shard.array.layout, rows)
        else:
            chunks = islice(chain.from_iterable(parts), *_chunk_range(shard))
        folder = shard.array.path.relative_to(self._root).as_posix()
        count = shard.array.rows_in(shard.number)
        written = array_writer.write_chunks(
            self._root, folder, shard.array.layout, shard.number, count, chunks
        )
        unit = f"{shard.stage.run}:{shard.stage.name}:{shard.number}"
        return LedgerEntry(unit, written.path, written.bytes, written.sha256, count)


def _chunk_range(shard: _Shard) -> tuple[int, int]:
    """Those of the chunks of the shard's units that lie in the shard."""
    layout = shard.array.layout
    first_row = shard.number * layout.shard_rows - shard.units.start * shard.stage.unit_rows
    first = first_row // layout.rows_per_chunk
    return first, first - (-shard.array.rows_in(shard.number) // layout.rows_per_chunk)


def _file_sizes(root: Path, array: StoredArray) -> dict[str, int]:
    """The sizes of the shards of an array that exist, by their paths inside the store."""
    folder = array.path.relative_to(root)
    if array.layout.is_flat:
        return {e.path: e.bytes for e in safe_files.names(root, folder) if e.kind == "file"}
    return {
        entry.path: entry.bytes for entry in safe_files.walk(root, folder) if entry.kind == "file"
    }
