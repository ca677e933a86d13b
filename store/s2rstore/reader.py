"""Read a store: the columns, frames and arrays of one generation."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.arrays.row_array import PartedArray, RowArray, row_numbers
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.errors import DamagedStoreError, NotComputedError, RequestError
from s2rstore.files import layout, safe_files
from s2rstore.geometry.map_grid import merged_aggregate
from s2rstore.index import column_loader
from s2rstore.index.catalog import IndexCatalog
from s2rstore.index.columns import InstanceColumns, RunColumns
from s2rstore.index.trajectory_parts import check_contiguous, trajectory_parts
from s2rstore.lru_cache import LruCache
from s2rstore.records import (
    NO_RUN,
    ArrayRecord,
    Coverage,
    Domain,
    Side,
    TrajectoryPart,
    needs_network,
)

# Which plane of a heatmap's leading axis each mode shows.
_PLANES: dict[str, dict[str, int]] = {"activation": {"x": 0, "y": 1, "heading": 2, "loss": 3}}
DEFAULT_MODES = {"activation": "loss", "occlusion": "rgbd", "pixel_difference": "rgb"}
"""The default mode of each heatmap kind that has modes."""
NETWORK_KINDS = frozenset({"activation", "feature_distance", "harmonised_distance", "occlusion"})
"""The heatmap kinds that need a network, so that a run of imported predictions has none."""
EMBEDDING_KINDS = frozenset({"embedding", "pca", "umap", "neighbour_distance"})
"""Arrays that are made of embeddings."""

SOURCE_IMAGES = {"rgb": "source_rgb", "depth": "source_depth"}
"""Arrays of images at the size of their source, where that is not the frame size."""

LOOSE_METRES, LOOSE_DEGREES = 1e-3, 0.01
"""Offsets of a pair up to which both images count as having one pose."""

_COLUMN_BYTES = 384 * 2**20
_EVALUATED_BYTES = 128 * 2**20
_EMBEDDING_BYTES = 512 * 2**20


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One view of one instance at the stored size.

    rgb (H, W, 3) uint8; depth (H, W), the raw values of the source; valid (H, W) bool.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.uint8] | NDArray[np.uint16]
    valid: NDArray[np.bool_]

    @classmethod
    def of(cls, rgb: NDArray[Any], depth: NDArray[Any], domain: Domain) -> Frame:
        """The frame of two images of a domain."""
        return cls(rgb, depth, (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max))


class Store(IndexCatalog):
    """A store at one generation; close it, or use `with`. Any thread may read it.

    `in_use` names the runs whose columns `drop_run_columns` keeps.
    """

    def __init__(
        self,
        path: str | Path,
        memory: str = "",
        generation: int | None = None,
        left_out: Collection[str] = (),
    ) -> None:
        super().__init__(path, memory, generation, left_out)
        self.in_use: frozenset[str] = frozenset()
        self._runs_columns: dict[str, RunColumns] = {}
        self._columns = LruCache(_COLUMN_BYTES)
        self._arrays: dict[str, StoredArray] = {}
        self._coverages: dict[str, Coverage] = {}
        self.evaluated = LruCache(_EVALUATED_BYTES)
        self.embeddings = LruCache(_EMBEDDING_BYTES)

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the index and empty the caches; arrays that callers hold stay valid."""
        super().close()
        for cache in (self._columns, self.evaluated, self.embeddings):
            cache.clear()

    @cached_property
    def _column_loader(self) -> column_loader.ColumnLoader:
        (row,) = self.execute("SELECT count(*) FROM instance")
        return column_loader.ColumnLoader(self.connection, self._columns, int(row[0]))

    @cached_property
    def instances(self) -> InstanceColumns:
        """Ground truth, aligned by iid; each column is loaded at its first use."""
        names = tuple(trajectory.trajectory for trajectory in self.trajectories)
        missing = self.missing_columns("instance")
        return column_loader.load_instances(self._column_loader, names, self.stored_rooms, missing)

    def poses(self, domain: str) -> NDArray[np.float64]:
        """The true poses of a domain's frames: x, y in metres and heading in radians, (N, 3).

        They are those of the instances, apart from frames of loose pairs, which have their own.
        """
        self.domain(domain)
        return self._columns.get(("poses", domain), lambda: self._read_poses(domain))

    def _read_poses(self, domain: str) -> NDArray[np.float64]:
        truth = self.instances
        poses = np.stack([truth.x, truth.y, truth.heading], axis=1)
        if self.has_own_poses(domain):
            query = "SELECT iid, {} AS value FROM frame_pose WHERE domain = ?"
            for place, name in enumerate(("x", "y", "heading")):
                own = self._column_loader.column(query.format(name), [domain])
                poses[:, place] = np.where(np.isnan(own), poses[:, place], own)
        return poses

    def has_own_poses(self, domain: str, start: int = 0, stop: int | None = None) -> bool:
        """Whether frames of iids [start, stop) have other poses than their instances."""
        if not self.has_table("frame_pose"):
            return False
        query = """
            SELECT 1 FROM frame_pose f JOIN instance i USING (iid)
            WHERE domain = ? AND iid >= ? AND iid < ?
            AND (f.x <> i.x OR f.y <> i.y OR f.heading <> i.heading) LIMIT 1
        """
        end = len(self.instances) if stop is None else stop
        return bool(self.execute(query, [domain, start, end]))

    def pair_offset(self, iid: int) -> str:
        """`0.23 m, 4.1 degrees` between both images of a pair; empty for one pose."""
        metres, degrees = (
            float(column[iid])
            for column in (self.instances.pair_offset_m, self.instances.pair_offset_deg)
        )
        is_loose = metres > LOOSE_METRES or degrees > LOOSE_DEGREES
        return f"{metres:.2f} m, {degrees:.1f} degrees" if is_loose else ""

    @cached_property
    def has_loose_pairs(self) -> bool:
        """Whether the images of some pair have different poses."""
        truth = self.instances
        is_far = truth.pair_offset_m > LOOSE_METRES
        return bool((is_far | (truth.pair_offset_deg > LOOSE_DEGREES)).any())

    def require_depth(self, domains: Iterable[str], purpose: str) -> None:
        """Raise RequestError where one of the domains has no depth, which `purpose` needs."""
        for domain in domains:
            if not self.domain(domain).has_depth:
                raise RequestError(f"{self.path}: domain {domain} has no depth; {purpose} needs it")

    def run_columns(self, run: str) -> RunColumns:
        """Predictions of a computed run, aligned by iid; each column is loaded at its first use.

        `NO_RUN` gives blank columns where the data set has no poses.
        """
        with self._lock:
            if run == NO_RUN and not self.has_poses and run not in self._runs_columns:
                self._runs_columns[run] = column_loader.unpredicted(len(self.instances))
            if run not in self._runs_columns:
                if self.run(run).key is None:
                    message = f"run {run!r}: not computed yet; run `s2r precompute`"
                    raise NotComputedError(message)
                self._runs_columns[run] = column_loader.load_run_columns(
                    self._column_loader, run, self.instances, self.rooms,
                    self.missing_columns("prediction"),
                )  # fmt: skip
            return self._runs_columns[run]

    def coverage(self, run: str) -> Coverage:
        """For how many instances a run is computed; for all in a store of one part.

        Of imported predictions, how many instances have one on both sides. Nothing needs to be
        computed for `NO_RUN`. Raises RequestError for an unknown run.
        """
        with self._lock:
            if run not in self._coverages:
                total = computed = self.parts[-1].stop
                is_imported = run != NO_RUN and self.run(run).is_imported
                if is_imported:
                    computed = self._imported_count(run)
                elif run != NO_RUN and (len(self.parts) > 1 or self.run(run).key is None):
                    computed = self._computed_count(run)
                self._coverages[run] = Coverage(run, computed, total, is_imported)
            return self._coverages[run]

    def _computed_count(self, run: str) -> int:
        """The instances with predictions; an index of hand-made rows has no arrays of them."""
        records = [record for record in self.array_parts(run) if record.kind == "prediction"]
        if records:
            return sum(record.shape[0] for record in records if record.side == "sim")
        query = "SELECT count(DISTINCT iid) FROM prediction WHERE run = ?"
        return int(self.execute(query, [run])[0][0])

    def _imported_count(self, run: str) -> int:
        """The instances with a predicted position on both sides."""
        query = """SELECT count(*) FROM (SELECT iid FROM prediction WHERE run = ? AND x IS NOT NULL
                   GROUP BY iid HAVING count(DISTINCT side) = 2)"""
        return int(self.execute(query, [run])[0][0])

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
        values = self._column_loader.of_side("accuracy", "prediction", run, side)
        return values.astype(np.float32)

    def frame(self, iid: int, domain: str) -> Frame:
        """Raises RequestError for an unknown instance or domain."""
        self.check_instance(iid)
        images = self.frames(domain, iid, iid + 1)
        return Frame.of(images["rgb"][0], images["depth"][0], self.domain(domain))

    def check_instance(self, iid: int) -> None:
        """Raise RequestError for an unknown instance."""
        count = len(self.instances)
        if not 0 <= iid < count:
            raise RequestError(f"instance {iid}: the store holds 0 .. {count - 1}")

    def frames(
        self, domain: str, start: int, stop: int, images: tuple[str, ...] = ("rgb", "depth")
    ) -> dict[str, NDArray[Any]]:
        """The images of iids [start, stop): rgb (n, H, W, 3) uint8, depth (n, H, W) raw values.

        Without depth it is 0, which is not valid. Raises RequestError where the domain does not
        image a trajectory of these instances.
        """
        has_depth = self.domain(domain).has_depth
        parts: dict[str, list[NDArray[Any]]] = {image: [] for image in images}
        for part, low, high in self._parts_of(start, stop):
            self._check_images(domain, part.trajectory)
            for image in images:
                if image == "depth" and not has_depth:
                    size = self.dataset.frame_height, self.dataset.frame_width
                    parts[image].append(np.zeros((high - low, *size), dtype=np.uint8))
                    continue
                array = self.frames_array(domain, part, image)
                parts[image].append(array.rows(low - part.first_iid, high - part.first_iid))
        return {
            image: rows[0] if len(rows) == 1 else np.concatenate(rows)
            for image, rows in parts.items()
        }

    def source_frames(
        self, domain: str, start: int, stop: int, images: tuple[str, ...] = ("rgb", "depth")
    ) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
        """The images of iids [start, stop) at the size of their source, and the first iid of each
        block.

        All images of one kind in a block have one size; RGB and depth may have different ones.
        Where a store holds none of that size, the images are those of `frames`. Without depth it
        is 0, in images of the size of RGB.
        """
        self.domain(domain)
        for part, low, high in self._parts_of(start, stop):
            if not self.has_source_frames(domain, part):
                yield low, self.frames(domain, low, high, images)
                continue
            stored = self._stored_images(domain, images)
            rows = low - part.first_iid, high - part.first_iid
            block = {each: self.source_array(domain, part, each).rows(*rows) for each in stored}
            if len(stored) < len(images):
                height, width = self.source_array(domain, part, "rgb").shape[1:3]
                block["depth"] = np.zeros((high - low, height, width), dtype=np.uint8)
            yield low, block

    def _parts_of(self, start: int, stop: int) -> Iterator[tuple[TrajectoryPart, int, int]]:
        """The parts of trajectories with some of iids [start, stop), first and last + 1 of each."""
        place = bisect_right(self.trajectory_parts, start, key=lambda part: part.first_iid)
        for part in self.trajectory_parts[max(place - 1, 0) :]:
            if part.first_iid >= stop:
                return
            low, high = max(start, part.first_iid), min(stop, part.stop)
            if low < high:
                yield part, low, high

    def _stored_images(self, domain: str, images: Iterable[str]) -> list[str]:
        """The images of a domain that are stored: without `depth` where it has none."""
        has_depth = self.domain(domain).has_depth
        return [image for image in images if has_depth or image != "depth"]

    def has_source_frames(self, domain: str, part: TrajectoryPart) -> bool:
        """Whether the store holds images of the size of their source besides the frames."""
        name = f"{layout.FRAMES}/{domain}/{part.folder}/{SOURCE_IMAGES['rgb']}"
        return f"{name}/{stored_array.METADATA}" in self.checksums

    def has_source_images(self, domain: str, start: int, stop: int) -> bool:
        """Whether `source_frames` and `frames` differ for any of iids [start, stop)."""
        return any(self.has_source_frames(domain, p) for p, _, _ in self._parts_of(start, stop))

    def source_size(self, domain: str, iid: int) -> dict[str, list[int]] | None:
        """Rows and columns of the source of each image, if they are stored; else None."""
        for part, _, _ in self._parts_of(iid, iid + 1):
            if self.has_source_frames(domain, part):
                stored = self._stored_images(domain, SOURCE_IMAGES)
                arrays = {image: self.source_array(domain, part, image) for image in stored}
                return {image: list(array.shape[1:3]) for image, array in arrays.items()}
        return None

    def source_array(self, domain: str, part: TrajectoryPart, image: str) -> StoredArray:
        """As `frames_array`, at the size of the source images."""
        relative = f"{layout.FRAMES}/{domain}/{part.folder}/{SOURCE_IMAGES[image]}"
        with self._lock:
            if relative not in self._arrays:
                array = stored_array.open_read(self.path / relative, self.path)
                shape = part.instances, *array.shape[1:3]
                types = ("uint8",) if image == "rgb" else ("uint8", "uint16")
                expected = self.checksums.get(f"{relative}/{stored_array.METADATA}")
                _check_metadata(array, (*shape, 3) if image == "rgb" else shape, types, expected)
                self._arrays[relative] = array
            return self._arrays[relative]

    @cached_property
    def imaged_trajectories(self) -> dict[str, frozenset[str]]:
        """The trajectories that each domain images: all of them, unless there are no poses."""
        known = frozenset(trajectory.trajectory for trajectory in self.trajectories)
        if self.has_poses:
            return dict.fromkeys(self.domains, known)
        query = "SELECT DISTINCT domain, trajectory FROM frame JOIN instance USING (iid)"
        rows = self.execute(query)
        return {name: known & {t for d, t in rows if d == name} for name in self.domains}

    def imaged(self, domain: str) -> NDArray[np.bool_]:
        """The instances that a domain images, shape (N,)."""
        self.domain(domain)
        truth, imaged = self.instances, self.imaged_trajectories[domain]
        codes = [code for code, name in enumerate(truth.trajectory_names) if name in imaged]
        return np.isin(truth.trajectory, codes)

    def _check_images(self, domain: str, trajectory: str) -> None:
        if trajectory not in self.imaged_trajectories[domain]:
            domains = [d for d, names in self.imaged_trajectories.items() if trajectory in names]
            raise RequestError(
                f"{self.path}: domain {domain} has no images of trajectory {trajectory} "
                f"(domains: {', '.join(domains)})"
            )

    def iids_of(self, trajectory: str) -> NDArray[np.int64]:
        """The instances of a trajectory in recording order, which is that of their iids."""
        parts = [part for part in self.trajectory_parts if part.trajectory == trajectory]
        ranges = [np.arange(part.first_iid, part.stop, dtype=np.int64) for part in parts]
        return np.concatenate(ranges) if ranges else np.zeros(0, dtype=np.int64)

    def in_recording_order(self, rows: Any) -> NDArray[np.int64]:
        """Instances, given by different iids or a mask (N,), by trajectory and position in it.

        That is the order of their iids unless instances were appended to a trajectory.
        """
        iids = row_numbers(rows)
        if np.asarray(rows).dtype != bool:
            iids = np.sort(iids)
        if self._follows_recordings:
            return iids
        return iids[np.argsort(self.instances.trajectory[iids], kind="stable")]

    @cached_property
    def _follows_recordings(self) -> bool:
        """Whether the order of iids is that of the trajectories."""
        return bool((np.diff(self.instances.trajectory) >= 0).all())

    @cached_property
    def trajectory_parts(self) -> tuple[TrajectoryPart, ...]:
        """In order of their instances; each has frame arrays of its own."""
        parts = tuple(trajectory_parts(self.execute))
        check_contiguous(parts, self.trajectories, self.path)
        return parts

    def frames_array(self, domain: str, part: TrajectoryPart, image: str) -> StoredArray:
        """The images of one kind, `rgb` or `depth`, of a part of a trajectory in one domain.

        RequestError where the array differs from the index.
        """
        relative = f"{layout.FRAMES}/{domain}/{part.folder}/{image}"
        with self._lock:
            if relative not in self._arrays:
                array = stored_array.open_read(self.path / relative, self.path)
                size = part.instances, self.dataset.frame_height, self.dataset.frame_width
                shape = (*size, 3) if image == "rgb" else size
                types = ("uint8",) if image == "rgb" else ("uint8", "uint16")
                expected = self.checksums.get(f"{relative}/{stored_array.METADATA}")
                _check_metadata(array, shape, types, expected)
                self._arrays[relative] = array
            return self._arrays[relative]

    def stored(self, record: ArrayRecord) -> StoredArray:
        """Open the array that an index row describes. RequestError if array and row differ."""
        relative = f"{layout.RUNS}/{record.path}"
        with self._lock:
            if relative not in self._arrays:
                self._arrays[relative] = stored_array.open_read(self.path / relative, self.path)
            array = self._arrays[relative]
        _check_metadata(array, record.shape, (record.dtype,), record.metadata_sha256)
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
        starts, stops = zip(*((part.first_iid, part.stop) for part in self.parts), strict=True)
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

        `mode` picks x, y, heading or loss for `activation`; rgb, depth or rgbd for `occlusion`, as
        far as the model has these channels; rgb or depth for `pixel_difference`. Occlusion gives
        its metres.
        """
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
        planes = _PLANES.get(kind)
        mode = mode or self.default_mode(run, kind)
        stored_mode = None if planes else mode
        record, array = self.array(run, kind, side, stored_mode)
        block = np.asarray(stored_array.read_rows(array, start, stop), np.float32)
        block = (block - np.float32(record.zero)) * np.float32(record.scale)
        if block.ndim == 3:
            return block
        if planes and mode not in planes:
            raise RequestError(f"{kind} has no mode {mode!r} (modes: x, y, heading, loss)")
        return np.asarray(block[:, planes[str(mode)] if planes else 0])

    def map_grid(
        self, run: str, kind: str, side: Side, mode: str | None = None, aggregate: str = "mean"
    ) -> NDArray[np.float32]:
        """A heatmap kind back-projected on the floor, aggregated over all valid instances.

        Shape (rows, columns); row 0 lies at the bounds' y0. NaN where no pixel fell. `aggregate`
        is mean, max, sum or count.
        """
        records = self._records_of(run, f"map:{kind}", side, mode or self.default_mode(run, kind))
        computed = {r.first_iid for r in self._records_of(run, "prediction", side, None)}
        if computed - {record.first_iid for record in records}:
            raise NotComputedError(_incomplete(run, kind))
        grids = []
        for array in map(self.stored, records):
            known = str(array.attrs["aggregates"]).split(",")
            if aggregate not in known:
                raise RequestError(f"aggregate {aggregate!r}: one of {', '.join(known)}")
            grids.append(dict(zip(known, np.asarray(array[:], dtype=np.float32), strict=True)))
        return merged_aggregate(grids, aggregate)

    def floor_plan_path(self) -> Path | None:
        """The image of the floor plan; None where the data set has none.

        Raises RequestError where it is a link or no regular file.
        """
        name = self.dataset.floor_plan
        return safe_files.checked_path(self.path, name) if name else None


def _incomplete(run: str, kind: str) -> str:
    return f"run {run!r}: {kind} is not computed for all instances; run `s2r precompute`"


def _check_metadata(
    array: StoredArray, shape: tuple[int, ...], types: tuple[str, ...], sha256: str | None
) -> None:
    """Raise DamagedStoreError where an array's metadata differs from the index."""
    if array.shape != shape or array.layout.dtype not in types:
        raise DamagedStoreError(
            f"{array.path}: {array.layout.dtype} {array.shape} instead of {' or '.join(types)} "
            f"{shape}, which the index states; run `s2r verify`"
        )
    if sha256 is not None and array.metadata_sha256 != sha256:
        raise DamagedStoreError(f"{array.path}: metadata is not as published; run `s2r verify`")
