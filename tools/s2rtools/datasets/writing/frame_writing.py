"""Decode the frames of a trajectory once, check them and write them shard by shard.

How many instances are usable is known only behind the last one, so the arrays' metadata is written
last. Depth images of one domain must have one type, the most common one; instances of every
combination of types are written apart, and one combination is kept.
"""

from __future__ import annotations

import dataclasses
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from s2rstore.files import atomic_writes
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.processors import available_processors
from s2rtools.common.read_ahead import map_ahead
from s2rtools.datasets.scan import DecodedFrame, InstanceRecord, Scan
from s2rtools.datasets.stored_instances import StoredTrajectory
from s2rtools.datasets.writing import source_arrays
from s2rtools.datasets.writing.frame_group import DepthTypes, FrameGroup, Frames, Sources
from s2rtools.datasets.writing.ingest_journal import (
    OTHER_TYPES,
    SHARD_ROWS,
    Block,
    IngestJournal,
    combination_folder,
    find_folder,
)
from s2rtools.datasets.writing.source_arrays import CompressedImages, compressed

NO_DEPTH = "no depth"
"""The depth type of frames without depth."""
_DECODING_BYTES = 256 << 20
"""Memory of all threads together for decoding source images."""
_READ_AHEAD = 3
"""Instances that are decoded in advance for each thread."""

ReportProgress = Callable[[int], None]
Decoded = tuple[Frames, Sources, list[InputIssue]]
"""The frames of a record and the images at the size of their source, both by domain, and the issues
of unusable frames."""


@dataclass(frozen=True, slots=True)
class FramePlace:
    """Where frames of a trajectory are written that has frames in the store already.

    `folder` is their folder in that of each domain, `depth_types` the depth type that they must
    have in a domain, because the others have it.
    """

    folder: str
    depth_types: Mapping[str, str]


def write_trajectory(
    scan: Scan,
    root: Path,
    name: str,
    progress: ReportProgress,
    place: FramePlace | None = None,
    journal: IngestJournal | None = None,
) -> StoredTrajectory | None:
    """Write the frames of a trajectory's usable instances below `root`; None where none is usable.

    They are written to a folder of the trajectory's name in that of each domain, or to `place`.
    What the `journal` of `root` has of them is taken over, and what is written is recorded there.

    Every source is decoded once, by one thread per processor, or fewer if source images are large,
    to bound the memory. In memory are the frames of one shard of every domain. `progress` is
    called with twice the number of decoded frames. Issues are added to the scan.
    """
    records = scan.trajectories[name]
    place = place or FramePlace(name, {})
    taken = None if journal is None else journal.taken(place.folder, len(records))
    is_recorded = taken is not None and taken.is_finished
    writer = _TrajectoryWriter(scan, root, name, place, journal, is_recorded)
    largest = max(source.pixels for record in records for source in record.sources.values())
    threads = max(1, min(available_processors(), _DECODING_BYTES // (8 * largest)))

    def decode(row: int) -> Decoded | None:
        return None if taken is not None and row in taken else _decode(scan, records[row])

    with ThreadPoolExecutor(threads) as pool:
        decoded = map_ahead(pool, decode, range(len(records)), _READ_AHEAD * threads)
        for row, result in enumerate(decoded):
            if result is None:
                assert taken is not None
                writer.take(row, taken[row])
                continue
            frames, sources, defects = result
            progress(2 * (len(frames) + len(defects)))
            if defects:
                writer.leave_out(row, defects)
            else:
                writer.add(row, frames, sources)
    return writer.finish()


def _decode(scan: Scan, record: InstanceRecord) -> Decoded:
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
    """Writes the instances of one trajectory, those of each combination of depth types apart.

    With `is_recorded`, the journal has all of them, and says which combination is kept.
    """

    def __init__(
        self,
        scan: Scan,
        root: Path,
        name: str,
        place: FramePlace,
        journal: IngestJournal | None,
        is_recorded: bool,
    ) -> None:
        self._scan, self._root, self._name, self._place = scan, root, name, place
        self._journal, self._is_recorded = journal, is_recorded
        self._domains: tuple[str, ...] = ()
        self._groups: dict[DepthTypes, FrameGroup] = {}
        self._rows, self._group_numbers = array("i"), array("i")
        self._conversions: dict[int, tuple[InputIssue, ...]] = {}
        self._source_sizes: dict[str, tuple[tuple[int, ...], ...]] = {}
        self._left_out: dict[int, list[InputIssue]] = {}

    def leave_out(self, row: int, issues: list[InputIssue]) -> None:
        """Report the record number `row`, which is not stored."""
        self._scan.issues += issues
        if self._journal is not None:
            self._left_out[row] = issues
            if len(self._left_out) == SHARD_ROWS:
                self._journal.add(self._block(()))

    def add(self, row: int, frames: Frames, sources: Sources) -> None:
        """Write the frames of the record number `row`.

        An instance with source images of another size than those of the first one is left out.
        """
        for domain, images in sources.items():
            usual = self._source_sizes.setdefault(domain, source_arrays.sizes(images))
            if source_arrays.sizes(images) != usual:
                source = self._scan.trajectories[self._name][row].sources[domain]
                file = source.file_names(self._scan)[0] or domain
                detail = f"not the size of the trajectory's first image in {domain}"
                self.leave_out(row, [InputIssue("wrong size", file, detail)])
                return
        types = tuple(depth_type(frame) for frame in frames.values())
        group = self._group(types, tuple(frames))
        if issues := tuple(issue for frame in frames.values() for issue in frame.issues):
            self._conversions[row] = issues
        self._rows.append(row)
        self._group_numbers.append(group.number)
        group.add(row, frames, sources)
        if self._journal is not None and group.pending_rows == SHARD_ROWS:
            self._journal.add(self._block(types, with_shards=True))

    def take(self, row: int, block: Block) -> None:
        """Take the record number `row` over from a block of an interrupted ingest."""
        if row in block.left_out:
            self._scan.issues += block.left_out[row]
            return
        for domain, sizes in block.source_sizes.items():
            self._source_sizes.setdefault(domain, sizes)
        group = self._group(block.types, tuple(block.digests))
        if row in block.conversions:
            self._conversions[row] = block.conversions[row]
        self._rows.append(row)
        self._group_numbers.append(group.number)
        group.take(row, block)

    def _group(self, types: DepthTypes, domains: tuple[str, ...]) -> FrameGroup:
        if types not in self._groups:
            stored = StoredTrajectory(self._scan.trajectories[self._name])
            number = len(self._groups)
            find = partial(find_folder, self._root) if self._is_recorded else combination_folder
            folders = {each: find(number, each, self._place.folder) for each in domains}
            self._groups[types] = FrameGroup(
                self._root, number, folders, self._place.folder, stored
            )
            self._domains = domains
        return self._groups[types]

    def _block(self, types: DepthTypes, with_shards: bool = False) -> Block:
        """The instances that were left out, and those of a combination, since their last blocks."""
        row = next(iter(self._left_out), 0)
        frames = len(self._domains) or len(self._scan.trajectories[self._name][row].sources)
        block = Block(self._place.folder, frames, self._left_out)
        self._left_out = {}
        if types in self._groups:
            self._groups[types].fill(block, with_shards)
            block.types, block.source_sizes = types, self._source_sizes
            block.conversions = {
                row: self._conversions[row] for row in block.rows if row in self._conversions
            }
        return block

    def finish(self) -> StoredTrajectory | None:
        """Keep the depth types of the place, or else the most common ones.

        The instances of other types become issues.
        """
        if not self._groups:
            self._record_end(None)
            return None
        expected = tuple(
            self._place.depth_types.get(domain)
            or Counter(types[number] for types in self._types()).most_common(1)[0][0]
            for number, domain in enumerate(self._domains)
        )
        self._report(expected)
        self._record_end(expected)
        kept = self._groups.pop(expected, None)
        if not self._is_recorded:  # otherwise they were removed when the journal was opened
            for other in self._groups.values():
                other.remove()
        if kept is not None:
            kept.finish()
        atomic_writes.remove(self._root, OTHER_TYPES)
        return None if kept is None else kept.stored

    def _record_end(self, expected: DepthTypes | None) -> None:
        """Record the instances that are in no block yet, and which depth types are kept."""
        if self._journal is None or self._is_recorded:
            return
        blocks = [self._block(types, types == expected) for types in self._groups or [()]]
        kept = self._groups.get(expected or ())
        self._journal.finish(self._place.folder, blocks, None if kept is None else kept.number)

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
                    detail = f"{found}, the others in {domain} are {usual}"
                    self._scan.issues.append(InputIssue("mixed depth types", file, detail))


def depth_type(frame: DecodedFrame) -> str:
    """The numpy type of a frame's depth image, or `NO_DEPTH`."""
    return NO_DEPTH if frame.depth is None else str(frame.depth.dtype)
