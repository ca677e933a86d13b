"""The journal of a folder in which a store is built: which instances lie in complete shards.

A line is written when the shards of 64 instances of a trajectory are complete. It holds what else
is known of these instances, and the issues of those that were left out before, so that a later
ingest of the same data takes them over without decoding. Every line begins with its CRC-32; lines
count up to the first one that is damaged or unfinished.
"""

from __future__ import annotations

import io
import json
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec

from s2rstore.arrays.stored_array import shard_name
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.scan import FrameChecksum, StoredTrajectory

NAME = "journal.jsonl"
SHARD_ROWS = 64
_VERSION = 3
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
    and image.
    """

    trajectory: str
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


class IngestJournal:
    """Writes the journal of a building folder, and gives what it held when it was opened.

    In memory are one block, and the place of each line in the file.
    """

    def __init__(self, root: Path, fingerprint: str) -> None:
        """Create the journal of a new folder, or continue that of an ingest with this fingerprint.

        Files that the journal does not prove are removed. The blocks of a trajectory count up to
        the first one of which a file lacks.
        """
        self._root = root
        self._places: dict[str, array[int]] = {}
        self.taken_instances = 0
        """The number of instances that are not decoded again."""
        files = {NAME}
        atomic_writes.write(root, NAME, self._proven_lines(_Header(fingerprint), files))
        _remove_others(root, files)

    def _proven_lines(self, header: _Header, files: set[str]) -> Iterator[bytes]:
        """The header and the lines that count; adds the files that these prove."""
        text = _line(header)
        yield text
        place = len(text)
        shards: Counter[str] = Counter()
        ended: set[str] = set()
        for text, block in _lines(self._root):
            if not isinstance(block, Block) or block.trajectory in ended:
                continue
            found = _files(block, shards[block.trajectory])
            if any(_size(self._root, path) != size for path, size in found.items()):
                ended.add(block.trajectory)
                continue
            shards[block.trajectory] += bool(found)
            files.update(found)
            self.taken_instances += len(block.rows) + len(block.left_out)
            self._places.setdefault(block.trajectory, array("q")).append(place)
            yield text
            place += len(text)

    def taken(self, trajectory: str) -> Iterator[Block]:
        """What was stored of a trajectory before the journal was opened; it is given once."""
        places = self._places.pop(trajectory, None)
        if places is None:
            return
        with io.BufferedReader(safe_files.open_read(self._root, NAME)) as file:
            for place in places:
                file.seek(place)
                block = _parsed(file.readline(_MAX_LINE))
                assert isinstance(block, Block)
                yield block

    def add(self, block: Block) -> None:
        """Record instances whose shards are complete and durable."""
        atomic_writes.append_lines(self._root, NAME, _line(block))

    def close(self) -> None:
        """Remove the journal: the store is complete."""
        atomic_writes.remove(self._root, NAME)


def fingerprint_of(root: Path) -> str | None:
    """The fingerprint of the scan that a folder was built from; None without a usable journal."""
    _, header = next(_lines(root), (b"", None))
    return header.fingerprint if isinstance(header, _Header) else None


def _lines(root: Path) -> Iterator[tuple[bytes, _Line]]:
    """The lines of a folder's journal up to the first unusable one; none without a journal."""
    try:
        file = io.BufferedReader(safe_files.open_read(root, NAME))
    except (OSError, RequestError):
        return
    with file:
        for number, text in enumerate(iter(lambda: file.readline(_MAX_LINE), b"")):
            line = _parsed(text)
            if line is None or isinstance(line, _Header) != (number == 0):
                return
            if isinstance(line, _Header) and line.version != _VERSION:
                return
            yield text, line


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
