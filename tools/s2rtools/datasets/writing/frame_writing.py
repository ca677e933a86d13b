"""Decode the frames of a trajectory once, check them and write them shard by shard.

How many instances are usable is known only behind the last one, so the arrays' metadata is written
last. Depth images of one domain must have one type: the one that most of their headers declare.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from s2rstore.files import layout
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.processors import available_processors
from s2rtools.common.read_ahead import map_ahead
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource
from s2rtools.datasets.scan import (
    DecodedFrame,
    FrameChecksum,
    InstanceRecord,
    Scan,
    StoredTrajectory,
)
from s2rtools.datasets.writing.ingest_journal import SHARD_ROWS, Block, IngestJournal
from s2rtools.datasets.writing.trajectory_arrays import (
    CompressedImages,
    compressed,
    domain_arrays,
    sizes_of,
)

NO_DEPTH = "no depth"
"""The depth type of frames without depth."""
_DECODING_BYTES = 256 << 20
"""Memory of all threads together for decoding source images."""
_READ_AHEAD = 3
"""Instances that are decoded in advance for each thread."""

ReportProgress = Callable[[int], None]
Frames = Mapping[str, DecodedFrame]
Sources = Mapping[str, CompressedImages]
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
    writer = _TrajectoryWriter(scan, root, name, place, journal)
    is_done = np.zeros(len(records), dtype=np.bool_)
    for block in () if journal is None else journal.taken(place.folder):
        writer.take(block)
        is_done[[*block.rows, *block.left_out]] = True
    progress(2 * int(is_done.sum()) * len(records[0].sources))
    rows = np.flatnonzero(~is_done).tolist()
    largest = max(source.pixels for record in records for source in record.sources.values())
    threads = max(1, min(available_processors(), _DECODING_BYTES // (8 * largest)))
    with ThreadPoolExecutor(threads) as pool:
        decoded = map_ahead(
            pool, lambda row: _decode(scan, records[row]), rows, _READ_AHEAD * threads
        )
        for row, (frames, sources, defects) in zip(rows, decoded, strict=True):
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
    """Writes the instances of one trajectory, and records in the journal what is complete."""

    def __init__(
        self, scan: Scan, root: Path, name: str, place: FramePlace, journal: IngestJournal | None
    ) -> None:
        self._scan, self._root, self._place, self._journal = scan, root, place, journal
        self._records = scan.trajectories[name]
        self._types = _declared_depth_types(scan, self._records) | dict(place.depth_types)
        self._stored, self._recorded = StoredTrajectory(self._records), 0
        self._arrays = {
            domain: domain_arrays(root, f"{layout.FRAMES}/{domain}/{place.folder}")
            for domain in self._records[0].sources
        }
        self._source_sizes: dict[str, tuple[tuple[int, ...], ...]] = {}
        self._issues: dict[int, Sequence[InputIssue]] = {}
        self._conversions: dict[int, tuple[InputIssue, ...]] = {}
        self._left_out: dict[int, list[InputIssue]] = {}

    def leave_out(self, row: int, issues: list[InputIssue]) -> None:
        """Report the record number `row`, which is not stored."""
        self._issues[row] = self._left_out[row] = issues
        if len(self._left_out) == SHARD_ROWS:
            self._record(Block(self._place.folder))

    def add(self, row: int, frames: Frames, sources: Sources) -> None:
        """Write the frames of the record number `row`.

        An instance is left out whose depth images have another type than those of the trajectory,
        or whose source images have another size than those of the first one.
        """
        if issues := self._differences(row, frames, sources):
            self.leave_out(row, issues)
            return
        if converted := tuple(issue for frame in frames.values() for issue in frame.issues):
            self._issues[row] = self._conversions[row] = converted
        for domain, frame in frames.items():
            arrays = self._arrays[domain]
            for image, pixels in (("rgb", frame.rgb), ("depth", frame.depth)):
                if pixels is not None:
                    arrays[image].add(pixels, pixels.shape, str(pixels.dtype))
            for image, each in sources[domain].items():
                arrays[image].add(each.content, each.shape, each.dtype)
        self._stored.add(
            row, {d: FrameChecksum(f.sha256, f.valid_fraction) for d, f in frames.items()}
        )
        if len(self._stored) - self._recorded == SHARD_ROWS:
            self._record_stored()

    def _differences(self, row: int, frames: Frames, sources: Sources) -> list[InputIssue]:
        """Issues of frames that do not go into the arrays of the trajectory."""
        of_row, issues = self._records[row].sources, []
        for domain, frame in frames.items():
            found = depth_type(frame)
            usual = self._types.setdefault(domain, found)
            if found != usual:
                file = of_row[domain].file_names(self._scan)[1] or domain
                detail = f"{found}, the others in {domain} are {usual}"
                issues.append(InputIssue("mixed depth types", file, detail))
        if issues:
            return issues
        for domain, images in sources.items():
            sizes = sizes_of(images)
            if sizes != self._source_sizes.setdefault(domain, sizes):
                file = of_row[domain].file_names(self._scan)[0] or domain
                detail = f"not the size of the trajectory's first image in {domain}"
                return [InputIssue("wrong size", file, detail)]
        return []

    def take(self, block: Block) -> None:
        """Take over what an interrupted ingest has recorded of some records."""
        self._issues |= block.left_out
        self._issues |= block.conversions
        self._source_sizes = {**block.source_sizes, **self._source_sizes}
        self._types = {**block.types, **self._types}
        for position, row in enumerate(block.rows):
            self._stored.add(row, block.checksums(position))
        for domain, shards in block.shards.items():
            for image, shard in shards.items():
                self._arrays[domain][image].take(shard, len(block.rows))
        self._recorded = len(self._stored)

    def _record_stored(self) -> None:
        """Record the instances that are in no block yet."""
        block = Block(self._place.folder)
        block.types, block.source_sizes = self._types, self._source_sizes
        block.conversions, self._conversions = self._conversions, {}
        start, self._recorded = self._recorded, len(self._stored)
        block.add_rows(self._stored, start)
        if block.rows:
            for domain, arrays in self._arrays.items():
                written = {name: each for name, each in arrays.items() if not each.is_empty}
                block.shards[domain] = {name: each.last_shard() for name, each in written.items()}
        self._record(block)

    def _record(self, block: Block) -> None:
        block.left_out, self._left_out = self._left_out, {}
        if self._journal is not None and (block.rows or block.left_out):
            self._journal.add(block)

    def finish(self) -> StoredTrajectory | None:
        """Record the last instances and complete the arrays."""
        self._record_stored()
        for _, issues in sorted(self._issues.items()):
            self._scan.issues += issues
        if not len(self._stored):
            return None
        entries: list[LedgerEntry] = []
        for domain, arrays in self._arrays.items():
            key = f"frames:{domain}:{self._place.folder}"
            files = [
                (shard, msgspec.structs.replace(entry, key=f"{key}:{image}:{shard}"))
                for image, each in arrays.items()
                for shard, entry in enumerate(each.finish())
            ]
            entries += [entry for _, entry in sorted(files, key=lambda file: file[0])]
        Ledger(self._root).add_entries(entries)
        return self._stored


def _declared_depth_types(scan: Scan, records: Sequence[InstanceRecord]) -> dict[str, str]:
    """The commonest type that the headers of depth images declare, in each domain."""
    counts: dict[str, Counter[str]] = {}
    for record in records:
        for domain, source in record.sources.items():
            if isinstance(source, ImageFrameSource) and (found := source.declared_depth_type()):
                counts.setdefault(domain, Counter())[found] += 1
    return {domain: each.most_common(1)[0][0] for domain, each in counts.items()}


def depth_type(frame: DecodedFrame) -> str:
    """The numpy type of a frame's depth image, or `NO_DEPTH`."""
    return NO_DEPTH if frame.depth is None else str(frame.depth.dtype)
