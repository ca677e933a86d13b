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
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import cast

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
OTHER_TYPES = ".other-depth-types"
_VERSION = 1
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
    """Instances of one combination of depth types, and those left out since the last block.

    `trajectory` is the name of the trajectory's folder in that of each domain. `rows` are numbers
    of the trajectory's records. `number` counts the combinations, `types` is the depth type of each
    domain. `digests` (64 hexadecimal characters a row) and `valid_fractions` are those of the
    frames, `shards` the files by domain and image. `frames` is the number of frames of every
    instance.
    """

    trajectory: str
    frames: int
    left_out: dict[int, list[InputIssue]] = {}
    number: int = 0
    types: tuple[str, ...] = ()
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


class _Finished(msgspec.Struct, forbid_unknown_fields=True):
    """All instances of a trajectory are in blocks; those of combination `kept` are stored."""

    finished: str
    kept: int | None


_Line = _Header | Block | _Finished
_KINDS: dict[str, type[_Header | _Finished]] = {"fingerprint": _Header, "finished": _Finished}
Place = tuple[int, int]
"""Offset and length of a line, bytes."""


def combination_folder(number: int, domain: str, trajectory: str) -> str:
    """Where the arrays of a combination of depth types are written; number 0 in its place."""
    base = f"{OTHER_TYPES}/{number}" if number else layout.FRAMES
    return f"{base}/{domain}/{trajectory}"


class TakenTrajectory:
    """What an earlier ingest has stored of a trajectory; blocks are read when they are needed.

    `steps` is the number of frames in its blocks. Where it `is_finished`, all rows are in blocks.
    """

    def __init__(self, path: Path, places: Sequence[Place], count: int, is_finished: bool) -> None:
        self.is_finished = is_finished
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


@dataclass(slots=True)
class _Written:
    """The lines of one trajectory; `kept` is known if it `is_finished`.

    Each block has its place, its combination of depth types, whether it has 64 rows, and the
    domain, the name below the folder of that, and the bytes of each of its files.
    """

    blocks: list[tuple[Place, int, bool, list[tuple[str, str, int]]]] = field(default_factory=list)
    finish: Place | None = None
    kept: int | None = None

    def add(self, place: Place, block: Block) -> None:
        """Add the block of a line."""
        shard = sum(number == block.number and bool(files) for _, number, _, files in self.blocks)
        files = [
            (domain, f"{image}/{_shard_name(each, shard)}", each.bytes)
            for domain, images in block.shards.items()
            for image, each in images.items()
        ]
        is_full = not block.rows or (len(block.rows) == SHARD_ROWS and bool(files))
        self.blocks.append((place, block.number, is_full, files))

    def proven(self, root: Path, trajectory: str) -> tuple[list[Place], set[str]]:
        """The places of the lines whose files exist in their size, and these files.

        Of a finished trajectory either all lines count or none: files of other combinations than
        the kept one may have been removed.
        """
        places: list[Place] = []
        paths: set[str] = set()
        for place, number, is_full, files in self.blocks:
            if self.finish is not None and number != self.kept:
                places.append(place)
                continue
            is_finished = self.finish is not None
            find = partial(find_folder, root) if is_finished else combination_folder
            found = {
                f"{find(number, domain, trajectory)}/{name}": size for domain, name, size in files
            }
            is_usable = is_full or is_finished
            if not is_usable or any(_size(root, path) != size for path, size in found.items()):
                if is_finished:
                    return [], set()
                break
            places.append(place)
            paths |= set(found)
        return places, paths


class IngestJournal:
    """Writes the journal of a building folder, and gives what it held when it was opened."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._places: dict[str, list[Place]] = {}
        self._finished: set[str] = set()

    @classmethod
    def begin(cls, root: Path, fingerprint: str) -> IngestJournal:
        """Begin the journal of an empty folder."""
        journal = cls(root)
        journal._append(_Header(fingerprint))
        return journal

    @classmethod
    def resume(cls, root: Path, fingerprint: str) -> IngestJournal:
        """Open the journal of an abandoned folder; remove all files that it does not prove."""
        written: dict[str, _Written] = {}
        for place, line in _lines(root):
            if isinstance(line, Block):
                written.setdefault(line.trajectory, _Written()).add(place, line)
            elif isinstance(line, _Finished):
                each = written.setdefault(line.finished, _Written())
                each.finish, each.kept = place, line.kept
        journal, paths = cls(root), set[str]()
        old: list[Place] = []
        header = _line(_Header(fingerprint))
        end = len(header)
        for trajectory, each in written.items():
            places, found = each.proven(root, trajectory)
            paths |= found
            journal._places[trajectory] = []
            for offset, length in places:
                journal._places[trajectory].append((end, length))
                old.append((offset, length))
                end += length
            if each.finish is not None and len(places) == len(each.blocks):
                journal._finished.add(trajectory)
                old.append(each.finish)
                end += each.finish[1]
        _remove_others(root, paths | {NAME})
        kept = (_read_at(root / NAME, place) for place in old)
        atomic_writes.write(root, NAME, itertools.chain([header], kept))
        return journal

    def taken(self, trajectory: str, count: int) -> TakenTrajectory:
        """What was stored of a trajectory of `count` records before the journal was opened."""
        places, is_finished = self._places.get(trajectory, []), trajectory in self._finished
        return TakenTrajectory(self._root / NAME, places, count, is_finished)

    def add(self, block: Block) -> None:
        """Record instances whose shards are complete and durable."""
        self._append(block)

    def finish(self, trajectory: str, blocks: Sequence[Block], kept: int | None) -> None:
        """Record the last instances of a trajectory, and which combination of types is kept."""
        self._append(*blocks, _Finished(trajectory, kept))

    def close(self) -> None:
        """Remove the journal: the store is complete."""
        atomic_writes.remove(self._root, NAME)

    def _append(self, *lines: _Line) -> None:
        atomic_writes.append_lines(self._root, NAME, b"".join(map(_line, lines)))


def fingerprint_of(root: Path) -> str | None:
    """The fingerprint of the scan that a folder was built from; None without a usable journal."""
    try:
        _, header = next(_lines(root), (None, None))
    except (OSError, RequestError):
        return None
    return header.fingerprint if isinstance(header, _Header) else None


def find_folder(root: Path, number: int, domain: str, trajectory: str) -> str:
    """Where the arrays of a combination lie: its own folder, or else that of the store."""
    own = combination_folder(number, domain, trajectory)
    return own if safe_files.kind(root, own) else combination_folder(0, domain, trajectory)


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
        kind = next((kind for key, kind in _KINDS.items() if key in content), Block)
        return cast(_Line, msgspec.convert(content, kind, str_keys=True))
    except (ValueError, TypeError, RecursionError):  # msgspec's errors are ValueErrors
        return None


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
