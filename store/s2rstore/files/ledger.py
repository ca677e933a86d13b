"""The ledger: one JSON line per finished work unit; nothing else proves that a unit is done.

Each process appends to a separate file with a random name, so that no two processes, also of two
hosts, share one. Lines that a killed
process left unfinished do not count.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated

import msgspec

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.process_identity import host_name, process_token

_COMPACTED = f"{layout.LEDGER}/compacted.jsonl"
_MAX_LINE = 65_536
_MAX_FILE = 2 << 30
"""Bytes of the file of one process, about 8 million entries."""


class LedgerEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A finished file: `key` names the work unit, `path` the file inside the store."""

    key: str
    path: str
    bytes: Annotated[int, msgspec.Meta(ge=0)]
    checksum: Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{64}\Z")]
    count: Annotated[int, msgspec.Meta(ge=0)]


_DECODER = msgspec.json.Decoder(LedgerEntry)


class Ledger:
    """The ledger of a store: reads all entries, adds those of this process."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def entries(self) -> Iterator[LedgerEntry]:
        """Every entry that was completely written, in no particular order."""
        for line in self._lines():
            entry = _parsed(line)
            if entry is not None:
                yield entry

    def unreadable_lines(self) -> int:
        """The number of lines without an entry: unfinished by a killed process, or damaged."""
        return sum(_parsed(line) is None for line in self._lines())

    def _lines(self) -> Iterator[bytes]:
        for name in self._files():
            with io.BufferedReader(safe_files.open_read(self._root, name)) as file:
                size = os.fstat(file.fileno()).st_size
                if size > _MAX_FILE:
                    raise RequestError(f"{self._root / name}: {size} bytes; restore the ledger")
                while line := file.readline(_MAX_LINE):  # pieces of a longer line do not parse
                    if line != b"\n":
                        yield line.rstrip(b"\n")

    def _files(self) -> list[str]:
        entries = safe_files.names(self._root, layout.LEDGER)
        return [e.path for e in entries if e.name.endswith(".jsonl") and e.kind in ("file", "link")]

    def add(self, key: str, files: list[tuple[str, int]]) -> None:
        """Record a unit whose files, given as (path inside the store, count), are complete.

        The files are made durable first, then the lines.
        """
        entries = []
        for relative, count in files:
            atomic_writes.sync(self._root, relative)
            size = safe_files.size(self._root, relative)
            checksum = safe_files.sha256(self._root, relative)
            entries.append(LedgerEntry(key, relative, size, checksum, count))
        self.add_entries(entries)

    def add_entries(self, entries: Iterable[LedgerEntry]) -> None:
        """Record files that are complete and durable."""
        lines = map(_line, entries)
        own = f"{layout.LEDGER}/{host_name()}-{process_token()}.jsonl"
        atomic_writes.append_lines(self._root, own, "".join(lines).encode())
        atomic_writes.sync(self._root, own)

    def by_path(self) -> dict[str, list[LedgerEntry]]:
        """Entries grouped by file; a file that was written several times has several."""
        grouped: dict[str, list[LedgerEntry]] = {}
        for entry in self.entries():
            grouped.setdefault(entry.path, []).append(entry)
        return grouped

    def proves(self, entries: list[LedgerEntry]) -> bool:
        """Whether one of a file's entries states its size and checksum.

        Raises LinkError where the path leads through a symbolic link.
        """
        try:
            size = safe_files.size(self._root, entries[0].path) if entries else None
            if all(entry.bytes != size for entry in entries):
                return False
            checksum = safe_files.sha256(self._root, entries[0].path)
        except OSError:
            return False
        return any((entry.bytes, entry.checksum) == (size, checksum) for entry in entries)

    def remove_entries(self, removed: set[str]) -> None:
        """Remove the entries of removed files, given by their paths inside the store.

        Only for the holder of the store's compute lock: other processes must not be adding.
        """
        lines = "".join(_line(entry) for entry in self.entries() if entry.path not in removed)
        old = self._files()
        atomic_writes.write(self._root, _COMPACTED, lines.encode())
        for path in old:
            if path != _COMPACTED:
                atomic_writes.remove(self._root, path)


def _line(entry: LedgerEntry) -> str:
    return msgspec.json.encode(entry).decode() + "\n"


def _parsed(line: bytes) -> LedgerEntry | None:
    try:
        return _DECODER.decode(line)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None
