"""Which units of stages are to be computed, and the shards that their results complete."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.arrays.array_writer import UnnamedShard
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, safe_files
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rstore.files.ledger import Ledger, LedgerEntry, LedgerReader
from s2rstore.geometry.map_grid import TOTALS
from s2rtools.precompute import unit_results
from s2rtools.precompute.unit_results import ChunkSizes, Receipt, UnitResult, decode_totals
from s2rtools.precompute.work_units import NUMPY, ArraySpec, Stage, WorkUnit

_FLUSHES_AT_ONCE = 4

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

    Receipts of computed units are passed to `finish`, which writes and records the shards that are
    complete. All values of the arrays of one key come from one environment.
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
        self._environments: dict[str, ComputeEnvironment] = {}
        self._shards: dict[str, list[_Shard]] = {}
        self._uses: Counter[str] = Counter()
        self._folders: list[str] = []
        self._unfinished: dict[str, WorkUnit] = {}
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
            atomic_writes.make_folder(self._root, folder)
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
            if result and not self._difference(unit, result.environment):
                self._claim(unit, result.environment)
                self._results[name] = result
                complete.append(unit)
            else:
                self.units.append(unit)
                self._unfinished[name] = unit
        for unit in complete:
            self._complete(unit)

    def _missing_shards(
        self, stage: Stage, spec: ArraySpec, published: Collection[str]
    ) -> Iterator[_Shard]:
        array = stage.create(self._root, spec)
        files = _file_sizes(self._root, array)
        names = [array.file(number) for number in range(array.layout.shards)]
        is_published = spec.path(stage.run) in published
        if is_published and files.keys() >= set(names):
            return
        entries = self._ledger.array_entries(spec.folder(stage.run))
        self._bind(spec.folder(stage.run), entries, is_published)
        per_shard, per_unit = array.layout.shard_rows, stage.unit_rows
        for number, name in enumerate(names):
            sizes = {entry.bytes for entry in entries.get(name, ())}
            if name in files and (is_published or files[name] in sizes):
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

    def _bind(
        self, folder: str, entries: Mapping[str, list[LedgerEntry]], is_published: bool
    ) -> None:
        """Bind the arrays of a key to the environment that computed them, as far as it is recorded.

        Of arrays that are not published, only shards that exist count.
        """
        if folder not in self._environments:
            found = recorded_environments(self._ledger, entries.values(), is_published)
            if len(found) == 1:  # the parts of merged arrays may have several
                (self._environments[folder],) = found

    def _chunk_sizes(self, unit: WorkUnit) -> dict[str, ChunkSizes]:
        """What the result of a unit holds of its missing arrays, by their paths."""
        name, rows = unit_results.file_name(unit.stage, unit.number), len(unit.instances)
        return {
            shard.path: ChunkSizes(-(-rows // shard.rows_per_chunk), shard.chunk_bytes)
            for shard in self._shards[name]
        }

    def environment(self, unit: WorkUnit, precision: str) -> ComputeEnvironment | None:
        """The environment that a unit must be computed in; None where any will do.

        It is that of the values which the arrays of the unit have already. `precision` is that of
        the stage. Raises RequestError where arrays of the unit were computed in different ones.
        """
        begun = self._begun(unit)
        if not begun:
            return None
        spec, first = min(begun, key=lambda each: each[0].is_shared)
        if difference := self._difference(unit, first):
            raise _mixed(unit.stage, difference)
        return msgspec.structs.replace(first, precision=precision) if spec.is_shared else first

    def _begun(self, unit: WorkUnit) -> list[tuple[ArraySpec, ComputeEnvironment]]:
        """For each array key of the unit that has values: one array, and their environment."""
        specs = {spec.folder(unit.stage.run): spec for spec in unit.missing}
        return [
            (spec, self._environments[folder])
            for folder, spec in specs.items() if folder in self._environments
        ]  # fmt: skip

    def _difference(self, unit: WorkUnit, environment: ComputeEnvironment) -> str:
        """How an environment differs from that of the unit's arrays; empty where it does not."""
        found = (
            _of_array(spec, environment).difference(_of_array(spec, begun))
            for spec, begun in self._begun(unit)
        )
        return next(filter(None, found), "")

    def finish(self, receipt: Receipt, is_checked: bool = False) -> WorkUnit:
        """Use the result that a receipt states, and return its unit.

        With `is_checked` the content is compared with the receipt's checksum. Raises RequestError
        where it differs, and for a unit that was computed in another environment than the first
        values of its arrays.
        """
        unit = self._unfinished.pop(receipt.unit)
        expected = self._chunk_sizes(unit)
        self._claim(unit, receipt.environment)
        unit_results.accept(self._root, unit, receipt)
        result = unit_results.read(self._root, unit, expected, is_checked)
        if result is None or result.sha256 != receipt.sha256:
            file = self._root / receipt.unit
            raise RequestError(f"{file}: not what {receipt.host} has written; run it again")
        self._results[receipt.unit] = result
        self._complete(unit)
        return unit

    def _claim(self, unit: WorkUnit, environment: ComputeEnvironment) -> None:
        """Bind the unit's arrays to an environment; RequestError where they have another one."""
        if difference := self._difference(unit, environment):
            raise _mixed(unit.stage, difference)
        for spec in unit.missing:
            self._environments[spec.folder(unit.stage.run)] = _of_array(spec, environment)

    def close(self) -> None:
        """Remove the folders of the results; all units are finished."""
        for folder in self._folders:
            atomic_writes.remove(self._root, folder)
        for folder in dict.fromkeys(str(Path(folder).parent) for folder in self._folders):
            if not safe_files.names(self._root, folder):
                atomic_writes.remove(self._root, folder)

    def _complete(self, unit: WorkUnit) -> None:
        """Write and record the shards that waited for this unit only, then drop their results."""
        shards = self._shards.pop(unit_results.file_name(unit.stage, unit.number))
        for shard in shards:
            shard.waiting.discard(unit.number)
        assembled = [shard for shard in shards if not shard.waiting]
        if not assembled:
            return
        entries: dict[str, list[LedgerEntry]] = defaultdict(list)
        with ThreadPoolExecutor(_FLUSHES_AT_ONCE) as pool:  # while the next one is put together
            flushes = []
            for shard in assembled:
                file, entry = self._write(shard)
                flushes.append(pool.submit(array_writer.name_shard, self._root, file))
                entries[shard.spec.folder(shard.stage.run)].append(entry)
            for flush in flushes:
                flush.result()
        for key, recorded in entries.items():
            self._ledger.add_array_entries(key, recorded)
        for shard in assembled:
            for name in shard.results:
                self._uses[name] -= 1
                if not self._uses[name]:
                    del self._results[name]
                    atomic_writes.remove(self._root, name)

    def _write(self, shard: _Shard) -> tuple[UnnamedShard, LedgerEntry]:
        """Write a shard from the results of its units; returns it and its entry for the ledger."""
        results = [self._results[name] for name in shard.results]
        with safe_files.folder(self._root, shard.folder) as folder:
            parts = (list(result.chunks(shard.path, folder)) for result in results)
            return self._write_parts(shard, parts)

    def _write_parts(
        self, shard: _Shard, parts: Iterator[list[bytes]]
    ) -> tuple[UnnamedShard, LedgerEntry]:
        """As `_write`, from the chunks of the units."""
        if shard.stage.is_aggregate:
            totals = ({shard.spec: decode_totals(part, shard.spec.item)} for part in parts)
            rows = self._merge(totals)[shard.spec]
            chunks: Iterable[bytes] = array_writer.encode_chunks(shard.array.layout, rows)
        else:
            chunks = islice(chain.from_iterable(parts), *_chunk_range(shard))
        folder = shard.array.path.relative_to(self._root).as_posix()
        count = shard.array.rows_in(shard.number)
        file = array_writer.write_unnamed(
            self._root, folder, shard.array.layout, shard.number, count, chunks
        )
        written = file.written
        unit = f"{shard.stage.run}:{shard.stage.name}:{shard.number}"
        environment = self._environments[shard.spec.folder(shard.stage.run)]
        size, checksum = written.bytes, written.sha256
        return file, LedgerEntry(unit, written.path, size, checksum, count, environment)


def recorded_environments(
    ledger: LedgerReader, entries: Iterable[list[LedgerEntry]], may_be_lost: bool = True
) -> list[ComputeEnvironment]:
    """The environments recorded in ledger entries of an array key, each once.

    Arrays that were merged may have several. Entries that fit existing files count first, and those
    of lost files only if they `may_be_lost`.
    """
    existing: list[LedgerEntry] = []
    lost: list[LedgerEntry] = []
    for of_file in entries:
        known = [entry for entry in of_file if entry.environment is not None]
        fitting = [entry for entry in known if ledger.states_size([entry])]
        if len({entry.checksum for entry in fitting}) > 1:
            fitting = [entry for entry in fitting if ledger.proves([entry])]
        existing += fitting
        lost += known
    chosen = existing or (lost[:1] if may_be_lost else [])
    found = {msgspec.json.encode(entry.environment): entry.environment for entry in chosen}
    return [environment for environment in found.values() if environment is not None]


def _of_array(spec: ArraySpec, environment: ComputeEnvironment) -> ComputeEnvironment:
    """The environment of an array; no network computes the ones that all runs share."""
    return msgspec.structs.replace(environment, precision=NUMPY) if spec.is_shared else environment


def _mixed(stage: Stage, difference: str) -> RequestError:
    return RequestError(
        f"{stage.run}: {stage.name}: {difference}, with which its arrays were begun; all values of "
        "an array come from one kind of worker: continue with that one, or add --restart to begin "
        "these arrays again"
    )


def _chunk_range(shard: _Shard) -> tuple[int, int]:
    """Those of the chunks of the shard's units that lie in the shard."""
    per_shard, per_chunk = shard.array.layout.shard_rows, shard.array.layout.rows_per_chunk
    first = (shard.number * per_shard - shard.units.start * shard.stage.unit_rows) // per_chunk
    return first, first - (-shard.array.rows_in(shard.number) // per_chunk)


def _file_sizes(root: Path, array: StoredArray) -> dict[str, int]:
    """The sizes of the shards of an array that exist, by their paths inside the store."""
    folder = array.path.relative_to(root)
    return {e.path: e.bytes for e in safe_files.names(root, folder) if e.kind == "file"}
