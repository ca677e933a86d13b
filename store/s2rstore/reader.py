"""Read a store: the runs of one generation, their columns and arrays, and the data set."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.arrays.row_array import PartedArray, RowArray
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.dataset_reader import DatasetReader, check_metadata, check_order
from s2rstore.errors import NotComputedError, RequestError
from s2rstore.files import layout
from s2rstore.files.store_files import Stamp
from s2rstore.geometry.map_grid import merged_aggregate
from s2rstore.heatmap_kinds import HEATMAPS
from s2rstore.index import column_loader
from s2rstore.index.columns import RunColumns
from s2rstore.lru_cache import LruCache
from s2rstore.records import (
    NO_RUN,
    SIDES,
    ArrayRecord,
    Coverage,
    Side,
    needs_network,
)

_PLANES = {
    kind: {mode: index for index, mode in enumerate(facts.planes)}
    for kind, facts in HEATMAPS.items()
    if facts.planes
}
"""Which plane of a heatmap's leading axis each mode shows."""
DEFAULT_MODES = {
    kind: facts.default_mode for kind, facts in HEATMAPS.items() if facts.default_mode is not None
}
"""The default mode of each heatmap kind that has modes."""
NETWORK_KINDS = frozenset(kind for kind, facts in HEATMAPS.items() if facts.needs_network)
"""The heatmap kinds that need a network, so that a run of imported predictions has none."""
EMBEDDING_KINDS = frozenset({"embedding", "pca", "umap", "neighbour_distance"})
"""Arrays that are made of embeddings."""

_EVALUATED_BYTES = 128 * 2**20
_EMBEDDING_BYTES = 512 * 2**20


class Store(DatasetReader):
    """A store at one generation; close it, or use `with`. Any thread may read it.

    `in_use` names the runs whose columns `drop_run_columns` keeps.
    """

    def _prepare(self) -> None:
        super()._prepare()
        self.in_use: frozenset[str] = frozenset()
        self._runs_columns: dict[str, RunColumns] = {}
        self._coverages: dict[str, Coverage] = {}
        self.selection_cache = LruCache(_EVALUATED_BYTES)
        self.embedding_cache = LruCache(_EMBEDDING_BYTES)

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the index and empty the caches; arrays that callers hold stay valid."""
        super().close()
        for cache in (self._columns, self.selection_cache, self.embedding_cache):
            cache.clear()

    def gap_history(self) -> tuple[Path, Stamp] | None:
        """The history of nightly gaps as a file of this machine; None where there is none.

        The stamp changes whenever the history does.
        """
        stamp = self.files.stamp(layout.GAP_HISTORY)
        return None if stamp is None else (self.files.local_file(layout.GAP_HISTORY), stamp)

    def run_columns(self, run: str) -> RunColumns:
        """Predictions of a computed run, aligned by iid; each column is loaded at its first use.

        `NO_RUN` gives blank columns, in which every instance is valid, where no run is computed.
        """
        with self._lock:
            if run == NO_RUN and not self.has_computed_run and run not in self._runs_columns:
                imaged = {side: self._imaged_side(side) for side in SIDES}
                self._runs_columns[run] = column_loader.unpredicted(len(self.instances), imaged)
            if run not in self._runs_columns:
                if self.run(run).key is None:
                    message = f"run {run!r}: not computed yet; run `s2r precompute`"
                    raise NotComputedError(message)
                self._runs_columns[run] = column_loader.load_run_columns(
                    self._column_loader, self.run(run), self.instances, self.rooms
                )
            return self._runs_columns[run]

    def _imaged_side(self, side: Side) -> NDArray[np.bool_]:
        """The instances with an image in a domain of a kind, (N,)."""
        domains = [domain.domain for domain in self.domains.values() if domain.kind == side]
        nothing = np.zeros(len(self.instances), dtype=np.bool_)
        return np.asarray(np.logical_or.reduce([nothing, *map(self.imaged, domains)]))

    def coverage(self, run: str) -> Coverage:
        """For how many instances a run is computed; for all that it can be in a store of one part.

        Of imported predictions, to how many instances both sides were applied, and how many of
        these have no pose on one of them. Nothing needs to be computed for `NO_RUN`. Raises
        RequestError for an unknown run.
        """
        with self._lock:
            if run not in self._coverages:
                self._coverages[run] = self._coverage(run)
            return self._coverages[run]

    def _coverage(self, run: str) -> Coverage:
        total = self.parts[-1].stop
        if run == NO_RUN:
            return Coverage(run, total, total)
        record = self.run(run)
        if record.is_imported:
            computed, lost = self._imported_counts(run)
            return Coverage(run, computed, total, is_imported=True, not_localised=lost)
        imaged = sum(map(len, self.imaged_ranges(record.sim_domain, record.real_domain)))
        computed, lone = self._computed_count(run), 0
        if predicted := self._predicted(run):
            missing = [self.imaged(record.domain(side)) & ~predicted[side] for side in SIDES]
            lone = int(np.count_nonzero(missing[0] ^ missing[1]))
        return Coverage(run, computed, imaged, not_imaged=total - imaged, not_predicted=lone)

    def _predicted(self, run: str) -> dict[Side, NDArray[np.bool_]]:
        """The instances that arrays of predictions hold, (N,) by side; empty without arrays."""
        records = [record for record in self.array_parts(run) if record.kind == "prediction"]
        predicted = {side: np.zeros(self.parts[-1].stop, dtype=np.bool_) for side in SIDES}
        for record in records:
            stop = record.first_iid + record.shape[0]
            if record.side is not None:
                predicted[record.side][record.first_iid : stop] = True
        return predicted if records else {}

    def _computed_count(self, run: str) -> int:
        """The instances with predictions; an index of hand-made rows has no arrays of them."""
        if predicted := self._predicted(run):
            return int(np.count_nonzero(predicted["sim"] & predicted["real"]))
        query = "SELECT count(DISTINCT iid) FROM prediction WHERE run = ?"
        return int(self.execute(query, [run])[0][0])

    def _imported_counts(self, run: str) -> tuple[int, int]:
        """The attempted instances, and those of them that have no position on some side."""
        query = """SELECT count(*), count(*) FILTER (located < 2) FROM (
                   SELECT iid, count(x) AS located FROM prediction
                   WHERE run = ? AND split IS NOT NULL
                   GROUP BY iid HAVING count(DISTINCT side) = 2)"""
        attempted, lost = self.execute(query, [run])[0]
        return int(attempted), int(lost)

    def drop_run_columns(self, run: str) -> None:
        """Free the memory of a run's columns; the next use loads them again."""
        if run not in self.in_use:
            self._columns.drop(lambda key: isinstance(key, tuple) and key[:2] == ("run", run))

    def has_loaded(self, run: str | None, side: Side | None, names: Iterable[str]) -> bool:
        """Whether columns are in memory.

        Side None are the columns of both sides, run None those of the ground truth.
        """
        prefix = ("instance",) if run is None else ("run", run, side)
        return all((*prefix, name) in self._columns for name in names)

    def accuracies(self, run: str, side: Side) -> NDArray[np.float32]:
        """Accuracies of one side of a run, (N,), NaN without a prediction; loads nothing else."""
        if side not in SIDES:
            raise RequestError(f"accuracies(run, side): side {side!r}: sim or real")
        values = self._column_loader.of_side("accuracy", "prediction", self.run(run).run, side)
        return values.astype(np.float32)

    def trained_instances(self, run: str) -> NDArray[np.bool_]:
        """The instances that a run's model was trained on, (N,); keeps nothing in memory."""
        return column_loader.trained_instances(self._column_loader, run)

    def stored(self, record: ArrayRecord) -> StoredArray:
        """Open the array that an index row describes. RequestError if array and row differ."""
        relative = f"{layout.RUNS}/{record.path}"
        with self._lock:
            if relative not in self._arrays:
                self._arrays[relative] = stored_array.open_array(self.files, relative)
            array = self._arrays[relative]
        check_metadata(array, record.shape, (record.dtype,), record.metadata_sha256)
        return array

    def array(
        self, run: str, kind: str, side: Side | None = None, mode: str | None = None
    ) -> tuple[ArrayRecord, RowArray]:
        """A published array with a row per instance, and the record of its first part.

        NotComputedError names the kinds that the run has. Reading instances that the run was not
        computed for raises it, too.
        """
        records = self._records_of(run, kind, side, mode)
        count = len(self.instances)
        first = records[0]
        is_of_instances = first.axes[:1] == ("iid",)
        if len(records) == 1 and (first.shape[:1] == (count,) or not is_of_instances):
            return first, self.stored(first)
        if not is_of_instances:
            raise RequestError(f"run {run!r}: {kind} has several parts; read it by `map_grid`")
        starts, stops = zip(*((p.first_iid, p.stop) for p in self.trajectory_parts), strict=True)
        for record in records:
            rows = record.shape[0]
            if record.first_iid not in starts or record.first_iid + rows not in stops:
                raise RequestError(f"run {run!r}: {kind} has {rows} rows; run `s2r verify`")
        parts = [(record.first_iid, self.stored(record)) for record in records]
        return first, PartedArray(parts, count, f"{kind} of run {run!r}")

    def _records_of(
        self, run: str, kind: str, side: Side | None, mode: str | None
    ) -> list[ArrayRecord]:
        """The parts of an array, in order of their instances."""
        records = self.array_parts(run)
        found = [
            record
            for record in records
            if record.kind == kind and record.side in (side, None) and record.mode == mode
        ]
        if found:
            return sorted(found, key=lambda record: record.first_iid)
        known = ", ".join(sorted({record.kind for record in records})) or "nothing"
        requested = " ".join(part for part in (kind, side, mode) if part)
        if self.run(run).is_imported:
            if kind.removeprefix("map:") in NETWORK_KINDS:
                raise NotComputedError(needs_network(run, kind.removeprefix("map:")))
            if kind in EMBEDDING_KINDS and not any(r.kind == "embedding" for r in records):
                message = f"run {run!r}: imported without embeddings, which {kind} needs"
                raise NotComputedError(f"{message}; add --embeddings to `s2r run import`")
        message = f"run {run!r} has no {requested} (has: {known}); run `s2r precompute`"
        raise NotComputedError(message)

    def heatmap(
        self, run: str, kind: str, side: Side, iid: int, mode: str | None = None
    ) -> NDArray[np.float32]:
        """One instance's heatmap (rows, columns); see the kind's record for the unit.

        `mode` picks x, y, heading or loss for `activation`; position, heading or loss for `harm`
        and `harm_fine`; rgb, depth or rgbd for `occlusion`, as far as the model has these
        channels; rgb or depth for `pixel_difference`. Occlusion gives its metres.
        """
        check_order("heatmap(run, kind, side, iid)", side, iid)
        self.check_instance(iid)
        return np.asarray(self.heatmaps(run, kind, side, iid, iid + 1, mode)[0])

    def default_mode(self, run: str, kind: str) -> str | None:
        """The mode of a heatmap kind that is shown unless another one is named.

        A model without depth or colours has only one mode of `occlusion`.
        """
        usual = DEFAULT_MODES.get(kind)
        if kind in _PLANES or usual is None:
            return usual
        modes = [record.mode for record in self.array_kinds(run) if record.kind == kind]
        return usual if usual in modes or not modes else modes[0]

    def heatmaps(
        self, run: str, kind: str, side: Side, start: int, stop: int, mode: str | None = None
    ) -> NDArray[np.float32]:
        """Heatmaps of iids [start, stop) as in `heatmap`, shape (n, rows, columns)."""
        check_order("heatmaps(run, kind, side, start, stop)", side, start, stop)
        planes = _PLANES.get(kind)
        mode = mode or self.default_mode(run, kind)
        stored_mode = None if planes else mode
        record, array = self.array(run, kind, side, stored_mode)
        block = np.asarray(stored_array.read_rows(array, start, stop), np.float32)
        block = (block - np.float32(record.zero)) * np.float32(record.scale)
        if block.ndim == 3:
            return block
        if planes and mode not in planes:
            raise RequestError(f"{kind} has no mode {mode!r} (modes: {', '.join(planes)})")
        return np.asarray(block[:, planes[str(mode)] if planes else 0])

    def map_grid(
        self, run: str, kind: str, side: Side, mode: str | None = None, aggregate: str = "mean"
    ) -> NDArray[np.float32]:
        """A heatmap kind back-projected on the floor, aggregated over all valid instances.

        Shape (rows, columns); row 0 lies at the bounds' y0. NaN where no pixel fell. `aggregate`
        is mean, max, sum or count.
        """
        records = self._records_of(run, f"map:{kind}", side, mode or self.default_mode(run, kind))
        if not self._covers_predictions(run, kind, side, {record.first_iid for record in records}):
            raise NotComputedError(_incomplete(run, kind))
        grids = []
        for array in map(self.stored, records):
            known = str(array.attrs["aggregates"]).split(",")
            if aggregate not in known:
                raise RequestError(f"aggregate {aggregate!r}: one of {', '.join(known)}")
            grids.append(dict(zip(known, np.asarray(array[:], dtype=np.float32), strict=True)))
        return merged_aggregate(grids, aggregate)

    def _covers_predictions(self, run: str, kind: str, side: Side, firsts: set[int]) -> bool:
        """Whether heatmaps and map grids, which begin at `firsts`, exist for all predicted pairs.

        A map grid does not state its instances: they are those of the heatmaps of its kind.
        """
        heat = [r for r in self.array_parts(run) if r.kind == kind and r.side in (side, None)]
        counts = {record.first_iid: record.shape[0] for record in heat}
        return firsts == counts.keys() and sum(counts.values()) == self._computed_count(run)


def _incomplete(run: str, kind: str) -> str:
    return f"run {run!r}: {kind} is not computed for all instances; run `s2r precompute`"
