"""Decode the frames of a trajectory once, check them and write them shard by shard.

How many instances are usable is known only behind the last one, so the arrays' metadata is written
last. Depth images of one domain must have one type, the most common one; instances of every
combination of types are written apart, and one combination is kept.
"""

from __future__ import annotations

import dataclasses
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from s2rstore.arrays import array_writer
from s2rstore.dataset_reader import SOURCE_IMAGES
from s2rstore.files import atomic_writes, layout
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rtools.common.processors import available_processors
from s2rtools.common.read_ahead import map_ahead
from s2rtools.datasets import source_arrays
from s2rtools.datasets.scan import DecodedFrame, InputIssue, InstanceRecord, Scan
from s2rtools.datasets.source_arrays import CompressedImages, SourceArray, compressed
from s2rtools.datasets.stored_instances import StoredTrajectory

SHARD_ROWS = 64
NO_DEPTH = "no depth"
"""The depth type of frames without depth."""
_DECODING_BYTES = 256 << 20
"""Memory of all threads together for decoding source images."""
_READ_AHEAD = 3
"""Instances that are decoded in advance for each thread."""
_OTHER_TYPES = ".other-depth-types"

ReportProgress = Callable[[int], None]
Frames = Mapping[str, DecodedFrame]
Sources = Mapping[str, CompressedImages]
DepthTypes = tuple[str, ...]
"""The depth type of each domain, in the order of the records' sources."""


@dataclass(frozen=True, slots=True)
class FramePlace:
    """Where frames of a trajectory are written that has frames in the store already.

    `folder` is their folder in that of each domain, `depth_types` the depth type that they must
    have in a domain, because the others have it.
    """

    folder: str
    depth_types: Mapping[str, str]


def write_trajectory(
    scan: Scan, root: Path, name: str, progress: ReportProgress, place: FramePlace | None = None
) -> StoredTrajectory | None:
    """Write the frames of a trajectory's usable instances below `root`; None where none is usable.

    They are written to a folder of the trajectory's name in that of each domain, or to `place`.

    Every source is decoded once, by one thread per processor, or fewer if source images are large,
    to bound the memory. In memory are the frames of one shard of every domain. `progress` is
    called with twice the number of decoded frames. Issues are added to the scan.
    """
    records = scan.trajectories[name]
    writer = _TrajectoryWriter(scan, root, name, place or FramePlace(name, {}))
    largest = max(source.pixels for record in records for source in record.sources.values())
    threads = max(1, min(available_processors(), _DECODING_BYTES // (8 * largest)))
    with ThreadPoolExecutor(threads) as pool:
        decoded = map_ahead(pool, partial(_decode, scan), records, _READ_AHEAD * threads)
        for row, (frames, sources, defects) in enumerate(decoded):
            progress(2 * (len(frames) + len(defects)))
            scan.issues += defects
            if not defects:
                writer.add(row, frames, sources)
    return writer.finish()


def _decode(scan: Scan, record: InstanceRecord) -> tuple[Frames, Sources, list[InputIssue]]:
    """The frames of a record and the images at the size of their source, both by domain, and the
    issues of unusable frames."""
    frames: dict[str, DecodedFrame] = {}
    sources: dict[str, CompressedImages] = {}
    defects: list[InputIssue] = []
    for name, source in record.sources.items():
        frame = source.decode(scan, scan.domains[name])
        if isinstance(frame, InputIssue):
            defects.append(frame)
        else:
            sources[name] = compressed(frame.source)
            frames[name] = dataclasses.replace(frame, source=None)
    return frames, sources, defects


class _TrajectoryWriter:
    """Writes the instances of one trajectory, those of each combination of depth types apart."""

    def __init__(self, scan: Scan, root: Path, name: str, place: FramePlace) -> None:
        self._scan, self._root, self._name, self._place = scan, root, name, place
        self._domains: tuple[str, ...] = ()
        self._groups: dict[DepthTypes, _Group] = {}
        self._rows, self._group_numbers = array("i"), array("i")
        self._conversions: dict[int, tuple[InputIssue, ...]] = {}
        self._source_sizes: dict[str, tuple[tuple[int, ...], ...]] = {}

    def add(self, row: int, frames: Frames, sources: Sources) -> None:
        """Write the frames of the record number `row`.

        An instance with source images of another size than those of the first one is left out.
        """
        for domain, images in sources.items():
            usual = self._source_sizes.setdefault(domain, source_arrays.sizes(images))
            if source_arrays.sizes(images) != usual:
                source = self._scan.trajectories[self._name][row].sources[domain]
                file = source.file_names(self._scan)[0] or domain
                detail = "not the size of the trajectory's first image"
                self._scan.issues.append(InputIssue("wrong size", file, detail))
                return
        types = tuple(depth_type(frame) for frame in frames.values())
        if types not in self._groups:
            stored = StoredTrajectory(self._scan.trajectories[self._name])
            number = len(self._groups)
            self._groups[types] = _Group(self._root, self._place.folder, number, frames, stored)
            self._domains = tuple(frames)
        group = self._groups[types]
        if issues := tuple(issue for frame in frames.values() for issue in frame.issues):
            self._conversions[row] = issues
        self._rows.append(row)
        self._group_numbers.append(group.number)
        group.add(row, frames, sources)

    def finish(self) -> StoredTrajectory | None:
        """Keep the depth types of the place, or else the most common ones.

        The instances of other types become issues.
        """
        if not self._groups:
            return None
        expected = tuple(
            self._place.depth_types.get(domain)
            or Counter(types[number] for types in self._types()).most_common(1)[0][0]
            for number, domain in enumerate(self._domains)
        )
        self._report(expected)
        kept = self._groups.pop(expected, None)
        for other in self._groups.values():
            other.remove()
        if kept is not None:
            kept.finish()
        atomic_writes.remove(self._root, _OTHER_TYPES)
        return None if kept is None else kept.stored

    def _types(self) -> Iterator[DepthTypes]:
        """The depth types of every written instance."""
        groups = list(self._groups)
        return (groups[number] for number in self._group_numbers)

    def _report(self, expected: DepthTypes) -> None:
        """Add the issues of instances of other types, and the conversions of the others."""
        for row, types in zip(self._rows, self._types(), strict=True):
            if types == expected:
                self._scan.issues += self._conversions.get(row, ())
                continue
            sources = self._scan.trajectories[self._name][row].sources
            for (domain, source), found, usual in zip(
                sources.items(), types, expected, strict=True
            ):
                if found != usual:
                    file = source.file_names(self._scan)[1] or domain
                    detail = f"{found}, the others are {usual}"
                    self._scan.issues.append(InputIssue("mixed depth types", file, detail))


class _Group:
    """The written instances of one combination of depth types.

    `number` counts the combinations; the arrays of number 0 are written in their final places.
    """

    def __init__(
        self, root: Path, folder: str, number: int, domains: Iterable[str], stored: StoredTrajectory
    ) -> None:
        self._base = f"{_OTHER_TYPES}/{number}" if number else layout.FRAMES
        self.number, self.stored = number, stored
        self._root, self._folder = root, folder
        self._arrays = {
            domain: {
                image: _GrowingArray(root, f"{self._base}/{domain}/{folder}/{image}")
                for image in ("rgb", "depth")
            }
            for domain in domains
        }
        self._sources = {
            domain: {
                image: SourceArray(root, f"{self._base}/{domain}/{folder}/{image}")
                for image in SOURCE_IMAGES.values()
            }
            for domain in domains
        }

    def add(self, row: int, frames: Frames, sources: Sources) -> None:
        """Write the frames of the record number `row`."""
        for domain, frame in frames.items():
            self._arrays[domain]["rgb"].add(frame.rgb)
            if frame.depth is not None:
                self._arrays[domain]["depth"].add(frame.depth)
        for domain, images in sources.items():
            for name, image in images.items():
                self._sources[domain][name].add(image)
        self.stored.add(row, frames)
        for domain, frame in frames.items():
            if domain not in self.stored.image_sizes:
                self.stored.image_sizes[domain] = _image_sizes(frame, sources[domain])

    def remove(self) -> None:
        """Remove what was written."""
        for arrays in self._arrays.values():
            for each in arrays.values():
                atomic_writes.remove(self._root, Path(each.folder).parent)

    def finish(self) -> None:
        """Complete the arrays, put them in their places and list their files in the ledger."""
        entries: list[LedgerEntry] = []
        for domain, arrays in self._arrays.items():
            written = f"{self._base}/{domain}/{self._folder}"
            place = f"{layout.FRAMES}/{domain}/{self._folder}"
            key = f"frames:{domain}:{self._folder}"
            files = [
                (image, shard, entry)
                for image, each in (arrays | self._sources[domain]).items()
                for shard, entry in enumerate(each.finish())
            ]
            for image, shard, entry in sorted(files, key=lambda file: file[1]):
                path = entry.path.replace(written, place, 1)
                entries.append(replace(entry, key=f"{key}:{image}:{shard}", path=path))
            if written != place:
                atomic_writes.move(self._root, written, place)
        Ledger(self._root).add_entries(entries)


class _GrowingArray:
    """An array whose shards are written as its rows come."""

    def __init__(self, root: Path, folder: str) -> None:
        self.folder = folder
        self._root = root
        self._rows: list[NDArray[Any]] = []
        self._count = 0
        self._entries: list[LedgerEntry] = []

    def add(self, row: NDArray[Any]) -> None:
        self._rows.append(row)
        self._count += 1
        if len(self._rows) == SHARD_ROWS:
            self._write_shard()

    def finish(self) -> list[LedgerEntry]:
        """Write the last shard and the metadata; gives the entries of the shards, without keys."""
        if self._rows:
            self._write_shard()
        if self._entries:
            array_writer.create(self._root / self.folder, self._layout, root=self._root)
        return self._entries

    def _write_shard(self) -> None:
        rows = np.stack(self._rows)
        self._rows = []
        self._layout = array_writer.plan_layout(
            self._count, rows.shape[1:], str(rows.dtype), SHARD_ROWS
        )
        shard = len(self._entries)
        file = array_writer.write_shard_of(self._root, self.folder, self._layout, shard, rows)
        self._entries.append(LedgerEntry("", file.path, file.bytes, file.sha256, len(rows)))


def _image_sizes(frame: DecodedFrame, source: CompressedImages) -> dict[str, list[int]]:
    """Rows and columns of the images that networks see, by image."""
    if source:
        return {
            image: list(source[name].shape[:2])
            for image, name in SOURCE_IMAGES.items()
            if name in source
        }
    images = {"rgb": frame.rgb, "depth": frame.depth}
    return {k: list(image.shape[:2]) for k, image in images.items() if image is not None}


def depth_type(frame: DecodedFrame) -> str:
    """The numpy type of a frame's depth image, or `NO_DEPTH`."""
    return NO_DEPTH if frame.depth is None else str(frame.depth.dtype)
