"""The journal of a folder in which a store is built: which instances lie in complete shards.

A line is written when the shards of 64 instances of a trajectory are complete. It holds what else
is known of these instances, and the issues of those that were left out before, so that a later
ingest of the same data takes them over without decoding. Every line begins with its CRC-32; lines
count up to the first one that is damaged or unfinished.
"""

from __future__ import annotations

import io
import itertools
import json
import os
import zlib
from collections import Counter, OrderedDict
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np

from s2rstore.arrays.stored_array import shard_name
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.scan import FrameChecksum
from s2rtools.datasets.stored_instances import StoredTrajectory

NAME = "journal.jsonl"
SHARD_ROWS = 64
_VERSION = 2
_CACHED_BLOCKS = 16
_MAX_LINE = 16 << 20
_HEX = 64
"""Characters of a SHA-256."""


class Shard(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A complete shard of an array: shape and type of a row, bytes and SHA-256 of the file."""

    item: tuple[int, ...]
    dtype: str
    bytes: int
    sha256: str


class Block(msgspec.Struct, forbid_unknown_fields=True):
    """Stored instances of a trajectory, and those left out since the last block.

    `trajectory` is the name of the trajectory's folder in that of each domain. `rows` are numbers
    of the trajectory's records. `types` is the depth type of each domain. `digests` (64 hexadecimal
    characters a row) and `valid_fractions` are those of the frames, `shards` the files by domain
    and image. `frames` is the number of frames of every instance.
    """

    trajectory: str
    frames: int
    left_out: dict[int, list[InputIssue]] = {}
    types: dict[str, str] = {}
    rows: list[int] = []
    digests: dict[str, str] = {}
    valid_fractions: dict[str, list[float]] = {}
    conversions: dict[int, tuple[InputIssue, ...]] = {}
    source_sizes: dict[str, tuple[tuple[int, ...], ...]] = {}
    shards: dict[str, dict[str, Shard]] = {}

    def checksums(self, position: int) -> dict[str, FrameChecksum]:
        """The checksums of a row's frames by domain."""
        span = slice(_HEX * position, _HEX * (position + 1))
        return {
            domain: FrameChecksum(digests[span], self.valid_fractions[domain][position])
            for domain, digests in self.digests.items()
        }

    def add_rows(self, stored: StoredTrajectory, start: int) -> None:
        """Add the instances of a trajectory from a position on."""
        self.rows = stored.row_numbers(start)
        for domain in stored.domains:
            frames = [stored.checksum(domain, k) for k in range(start, len(stored))]
            self.digests[domain] = "".join(frame.sha256 for frame in frames)
            self.valid_fractions[domain] = [frame.valid_fraction for frame in frames]


class _Header(msgspec.Struct, forbid_unknown_fields=True):
    fingerprint: str
    version: int = _VERSION


_Line = _Header | Block
Place = tuple[int, int]
"""Offset and length of a line, bytes."""


class TakenTrajectory:
    """What an earlier ingest has stored of a trajectory; blocks are read when they are needed.

    `steps` is the number of frames in its blocks.
    """

    def __init__(self, path: Path, places: Sequence[Place], count: int) -> None:
        self.steps = 0
        self._path, self._places = path, places
        self._block_of = np.full(count, -1, np.int32)
        self._cached: OrderedDict[int, Block] = OrderedDict()
        for number in range(len(places)):
            block = self._block(number)
            rows = [*block.rows, *block.left_out]
            self._block_of[rows] = number
            self.steps += len(rows) * block.frames

    def __len__(self) -> int:
        return int(np.count_nonzero(self._block_of >= 0))

    def __contains__(self, row: int) -> bool:
        return bool(self._block_of[row] >= 0)

    def __getitem__(self, row: int) -> Block:
        """The block of a record that it contains."""
        return self._block(int(self._block_of[row]))

    def _block(self, number: int) -> Block:
        if number not in self._cached:
            block = _parsed(_read_at(self._path, self._places[number]))
            if not isinstance(block, Block):
                raise RequestError(f"{self._path}: was changed; remove its folder and ingest again")
            self._cached[number] = block
            if len(self._cached) > _CACHED_BLOCKS:
                self._cached.popitem(last=False)
        self._cached.move_to_end(number)
        return self._cached[number]


class IngestJournal:
    """Writes the journal of a building folder, and gives what it held when it was opened."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._places: dict[str, list[Place]] = {}

    @classmethod
    def begin(cls, root: Path, fingerprint: str) -> IngestJournal:
        """Begin the journal of an empty folder."""
        journal = cls(root)
        journal.add(_Header(fingerprint))
        return journal

    @classmethod
    def resume(cls, root: Path, fingerprint: str) -> IngestJournal:
        """Open the journal of an abandoned folder; remove all files that it does not prove.

        The blocks of a trajectory count up to the first one of which a file lacks.
        """
        journal, files = cls(root), {NAME}
        shards: Counter[str] = Counter()
        ended: set[str] = set()
        header = _line(_Header(fingerprint))
        old: list[Place] = []
        end = len(header)
        for place, block in _lines(root):
            if not isinstance(block, Block) or block.trajectory in ended:
                continue
            found = _files(block, shards[block.trajectory])
            if any(_size(root, path) != size for path, size in found.items()):
                ended.add(block.trajectory)
                continue
            shards[block.trajectory] += bool(found)
            files |= found.keys()
            old.append(place)
            journal._places.setdefault(block.trajectory, []).append((end, place[1]))
            end += place[1]
        _remove_others(root, files)
        kept = (_read_at(root / NAME, place) for place in old)
        atomic_writes.write(root, NAME, itertools.chain([header], kept))
        return journal

    def taken(self, trajectory: str, count: int) -> TakenTrajectory:
        """What was stored of a trajectory of `count` records before the journal was opened."""
        return TakenTrajectory(self._root / NAME, self._places.get(trajectory, []), count)

    def add(self, line: _Line) -> None:
        """Record instances whose shards are complete and durable."""
        atomic_writes.append_lines(self._root, NAME, _line(line))

    def close(self) -> None:
        """Remove the journal: the store is complete."""
        atomic_writes.remove(self._root, NAME)


def fingerprint_of(root: Path) -> str | None:
    """The fingerprint of the scan that a folder was built from; None without a usable journal."""
    try:
        _, header = next(_lines(root), (None, None))
    except (OSError, RequestError):
        return None
    return header.fingerprint if isinstance(header, _Header) else None


def _lines(root: Path) -> Iterator[tuple[Place, _Line]]:
    """The lines before the first damaged one, and their places; the first one is the header."""
    offset = 0
    with io.BufferedReader(safe_files.open_read(root, NAME)) as file:
        while text := file.readline(_MAX_LINE):
            line = _parsed(text)
            is_first = offset == 0
            if line is None or isinstance(line, _Header) != is_first:
                return
            if isinstance(line, _Header) and line.version != _VERSION:
                return
            yield (offset, len(text)), line
            offset += len(text)


def _line(line: _Line) -> bytes:
    """One line; issues may name files whose names are not UTF-8, which the JSON escapes."""
    text = json.dumps(msgspec.to_builtins(line)).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _parsed(line: bytes) -> _Line | None:
    checksum, _, text = line.partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text[:-1]):
        return None
    try:
        content = json.loads(text)
        if "fingerprint" in content:
            return msgspec.convert(content, _Header)
        return msgspec.convert(content, Block, str_keys=True)
    except (ValueError, TypeError, RecursionError):  # msgspec's errors are ValueErrors
        return None


def _files(block: Block, number: int) -> dict[str, int]:
    """The files of a block, whose shards have a number, and their bytes."""
    return {
        f"{layout.FRAMES}/{domain}/{block.trajectory}/{image}/{_shard_name(shard, number)}":
            shard.bytes
        for domain, images in block.shards.items()
        for image, shard in images.items()
    }  # fmt: skip


def _shard_name(shard: Shard, number: int) -> str:
    return shard_name(Layout((1, *shard.item), shard.dtype, SHARD_ROWS, 1), number)


def _read_at(path: Path, place: Place) -> bytes:
    offset, length = place
    with path.open("rb") as file:
        return os.pread(file.fileno(), length, offset)


def _size(root: Path, path: str) -> int | None:
    try:
        return safe_files.size(root, path)
    except (OSError, RequestError):
        return None


def _remove_others(root: Path, kept: set[str]) -> None:
    """Remove all files but some, and folders that become empty."""
    folders = []
    for entry in list(safe_files.walk(root)):
        if entry.kind == "folder":
            folders.append(entry.path)
        elif entry.path not in kept:
            atomic_writes.remove(root, entry.path)
    for folder in reversed(folders):  # a folder comes before its content
        if not safe_files.names(root, folder):
            atomic_writes.remove(root, folder)
