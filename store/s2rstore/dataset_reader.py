"""Read the data set of a store: ground truth, frames and images at the size of their source."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.arrays.row_array import row_numbers
from s2rstore.arrays.stored_array import StoredArray
from s2rstore.errors import DamagedStoreError, RequestError
from s2rstore.files import layout
from s2rstore.image_faults import FAULTS
from s2rstore.index import column_loader, schema
from s2rstore.index.catalog import IndexCatalog
from s2rstore.index.columns import InstanceColumns
from s2rstore.index.trajectory_parts import check_contiguous, trajectory_parts
from s2rstore.lru_cache import LruCache
from s2rstore.records import Domain, TrajectoryPart

SOURCE_IMAGES = {"rgb": "source_rgb", "depth": "source_depth"}
"""Arrays of images at the size of their source, where that is not the frame size."""

UNLABELLED = 0
"""The value of pixels of label images that show no labelled object."""

LOOSE_METRES, LOOSE_DEGREES = 1e-3, 0.01
_COMPARABLE_METRES, _COMPARABLE_DEGREES = 0.02, 0.5
"""Offsets of a pair up to which both images count as having one pose."""

_COUNT = re.compile(r"[0-9]{1,10}\Z")
_COLUMN_BYTES = 384 * 2**20


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


class DatasetReader(IndexCatalog):
    """The data set of a store at one generation; runs are added by `reader.Store`."""

    def _prepare(self) -> None:
        super()._prepare()
        self._columns = LruCache(_COLUMN_BYTES)
        self._arrays: dict[str, StoredArray] = {}
        self._with_frames: dict[str, bool] = {}

    @cached_property
    def _column_loader(self) -> column_loader.ColumnLoader:
        (row,) = self.execute("SELECT count(*) FROM instance")
        return column_loader.ColumnLoader(self.connection, self._columns, int(row[0]))

    @cached_property
    def instances(self) -> InstanceColumns:
        """Ground truth, aligned by iid; each column is loaded at its first use."""
        names = tuple(trajectory.trajectory for trajectory in self.trajectories)
        rooms = self.stored_rooms
        return column_loader.load_instances(self._column_loader, names, rooms, self.imaged)

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
        query = """
            SELECT 1 FROM frame_pose f JOIN instance i USING (iid)
            WHERE domain = ? AND iid >= ? AND iid < ?
            AND (f.x <> i.x OR f.y <> i.y OR f.heading <> i.heading) LIMIT 1
        """
        end = len(self.instances) if stop is None else stop
        return bool(self.execute(query, [domain, start, end]))

    @cached_property
    def domains_with_own_poses(self) -> frozenset[str]:
        """The domains where the poses of some frames differ from those of their instances."""
        return frozenset(domain for domain in self.domains if self.has_own_poses(domain))

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

    @cached_property
    def comparable_pairs(self) -> NDArray[np.bool_]:
        """(N,) the pairs whose images have nearly one pose, so that their contents compare."""
        truth = self.instances
        is_near: NDArray[np.bool_] = truth.pair_offset_m <= _COMPARABLE_METRES
        return is_near & (truth.pair_offset_deg <= _COMPARABLE_DEGREES)

    def require_depth(self, domains: Iterable[str], purpose: str) -> None:
        """Raise RequestError where one of the domains has no depth, which `purpose` needs."""
        for domain in domains:
            if not self.domain(domain).has_depth:
                raise RequestError(f"{self.path}: domain {domain} has no depth; {purpose} needs it")

    def frame(self, domain: str, iid: int) -> Frame:
        """Raises RequestError for an unknown instance or domain."""
        check_order("frame(domain, iid)", domain, iid)
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
        check_order("frames(domain, start, stop)", domain, start, stop)
        has_depth = self.domain(domain).has_depth
        parts: dict[str, list[NDArray[Any]]] = {image: [] for image in images}
        for part, low, high in self._parts_of(start, stop):
            self._check_images(domain, part)
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
        check_order("source_frames(domain, start, stop)", domain, start, stop)
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
                array = stored_array.open_array(self.files, relative)
                shape = part.instances, *array.shape[1:3]
                types = ("uint8",) if image == "rgb" else ("uint8", "uint16")
                expected = self.checksums.get(f"{relative}/{stored_array.METADATA}")
                check_metadata(array, (*shape, 3) if image == "rgb" else shape, types, expected)
                self._arrays[relative] = array
            return self._arrays[relative]

    @property
    def checked_domains(self) -> dict[str, int]:
        """The domains whose images `s2r check` has checked, with the number of images then."""
        facts = self.provenance(schema.HEALTH)
        return {
            name: int(facts[name]) for name in self.domains if _COUNT.match(facts.get(name, ""))
        }

    def faults(self, domain: str) -> dict[str, NDArray[np.bool_]]:
        """(N,) the images of a domain with each of `FAULTS`, those that `s2r check` found."""
        query = "SELECT DISTINCT fault FROM frame_fault WHERE domain = ?"
        present = {name for (name,) in self.execute(query, [domain])}
        query = "SELECT iid, 1 AS value FROM frame_fault WHERE domain = ? AND fault = ?"
        return {
            name: self._column_loader.column(query, [domain, name], 0).astype(np.bool_)
            for name in FAULTS
            if name in present
        }

    @property
    def label_keys(self) -> dict[str, str]:
        """The domains that have label images, with the key of their arrays."""
        return self.provenance(schema.LABELS)

    def labels_folder(self, domain: str, part: TrajectoryPart) -> str | None:
        """The folder of the label images of a part of a trajectory, inside the store; or None."""
        folder = labels_folder(domain, part.folder, self.label_keys.get(domain, ""))
        return folder if f"{folder}/{stored_array.METADATA}" in self.checksums else None

    def labels_array(self, part: TrajectoryPart, folder: str) -> StoredArray:
        """The label images (n, H, W) of a part of a trajectory in its `labels_folder`."""
        with self._lock:
            if folder not in self._arrays:
                array = stored_array.open_array(self.files, folder)
                size = self.dataset.frame_height, self.dataset.frame_width
                expected = self.checksums.get(f"{folder}/{stored_array.METADATA}")
                check_metadata(array, (part.instances, *size), ("uint16",), expected)
                self._arrays[folder] = array
            return self._arrays[folder]

    def label_images(self, domain: str, start: int, stop: int) -> NDArray[np.uint16]:
        """Label images of iids [start, stop) at the frame size, (n, H, W).

        A pixel holds the value of the object in `label_names`, or `UNLABELLED`; so do all pixels of
        a frame without a label image.
        """
        check_order("label_images(domain, start, stop)", domain, start, stop)
        self.domain(domain)
        size = self.dataset.frame_height, self.dataset.frame_width
        images = np.full((stop - start, *size), UNLABELLED, dtype=np.uint16)
        for part, low, high in self._parts_of(start, stop):
            if folder := self.labels_folder(domain, part):
                rows = low - part.first_iid, high - part.first_iid
                images[low - start : high - start] = self.labels_array(part, folder).rows(*rows)
        return images

    @cached_property
    def imaged_parts(self) -> dict[str, frozenset[TrajectoryPart]]:
        """The parts of trajectories of which each domain has images, by table `frame`.

        A domain has an image of every instance of a part, or of none.
        """
        parts = {part.first_iid: part for part in self.trajectory_parts}
        query = "SELECT domain, iid FROM frame WHERE iid IN (SELECT unnest(?::INTEGER[]))"
        rows = self.execute(query, [list(parts)])
        return {
            name: frozenset(parts[iid] for domain, iid in rows if domain == name)
            for name in self.domains
        }

    def imaged(self, *domains: str) -> NDArray[np.bool_]:
        """The instances that every one of the domains images, shape (N,)."""
        imaged = np.zeros(self.parts[-1].stop, dtype=bool)
        for iids in self.imaged_ranges(*domains):
            imaged[iids.start : iids.stop] = True
        return imaged

    def is_imaged(self, domain: str, iid: int) -> bool:
        """Whether a domain images an instance."""
        imaged = self.imaged_parts[self.domain(domain).domain]
        return all(part in imaged for part, _, _ in self._parts_of(iid, iid + 1))

    def imaged_ranges(self, *domains: str, without: str | None = None) -> list[range]:
        """Ranges of instances with images in all of the domains, each in one part of the store.

        Those with an image in domain `without` are left out.
        """
        ranges: list[range] = []
        previous = None
        wanted = [self.imaged_parts[self.domain(each).domain] for each in domains]
        unwanted = self.imaged_parts[without] if without else frozenset()
        for part in self.trajectory_parts:
            if part in unwanted or not all(part in parts for parts in wanted):
                continue
            if ranges and part.part == previous and ranges[-1].stop == part.first_iid:
                ranges[-1] = range(ranges[-1].start, part.stop)
            else:
                ranges.append(range(part.first_iid, part.stop))
            previous = part.part
        return ranges

    def _check_images(self, domain: str, part: TrajectoryPart) -> None:
        if part not in self.imaged_parts[domain]:
            domains = [each for each, parts in self.imaged_parts.items() if part in parts]
            raise RequestError(
                f"{self.path}: domain {domain} has no images of trajectory {part.trajectory} "
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
                array = stored_array.open_array(self.files, relative)
                size = part.instances, self.dataset.frame_height, self.dataset.frame_width
                shape = (*size, 3) if image == "rgb" else size
                types = ("uint8",) if image == "rgb" else ("uint8", "uint16")
                expected = self.checksums.get(f"{relative}/{stored_array.METADATA}")
                check_metadata(array, shape, types, expected)
                self._arrays[relative] = array
            return self._arrays[relative]

    def floor_plan_path(self) -> Path | None:
        """The image of the floor plan; None where the data set has none.

        Raises RequestError where it is a link or no regular file.
        """
        name = self.dataset.floor_plan
        return self.files.local_file(name, self.checksums.get(name)) if name else None

    def has_frames(self, domain: str) -> bool:
        """Whether the store holds images of a domain, of any trajectory."""
        if domain not in self._with_frames:
            folders = (f"{layout.FRAMES}/{domain}/{p.folder}/rgb" for p in self.trajectory_parts)
            documents = (f"{folder}/{stored_array.METADATA}" for folder in folders)
            self._with_frames[domain] = any(map(self.files.kind, documents))
        return self._with_frames[domain]


def labels_folder(domain: str, part: str, key: str) -> str:
    """The folder of the label images of a part of a trajectory, inside the store."""
    return f"{layout.FRAMES}/{domain}/{part}/{layout.LABEL_IMAGES}{key}"


def check_metadata(
    array: StoredArray, shape: tuple[int, ...], types: tuple[str, ...], sha256: str | None
) -> None:
    """Raise DamagedStoreError where an array's metadata differs from the index."""
    if array.shape != shape or array.layout.dtype not in types:
        raise DamagedStoreError(
            f"{array.path}: {array.layout.dtype} {array.shape} instead of {' or '.join(types)} "
            f"{shape}, which the index states; run `s2r verify`"
        )
    if array.metadata_sha256 != sha256:
        raise DamagedStoreError(f"{array.path}: metadata is not as published; run `s2r verify`")


def check_order(usage: str, name: Any, *numbers: Any) -> None:
    """Raise RequestError where a name and numbers of instances are exchanged."""
    if not isinstance(name, str) or not all(hasattr(each, "__index__") for each in numbers):
        raise RequestError(f"{usage}: names are texts, instances are numbers; check their order")
