"""The ledger: one JSON line per finished file; nothing else proves that a file is complete.

The lines of computed arrays lie in `ledger/arrays/RUN/KEY.*.jsonl`, so that those of one key can be
read without the others; all other lines lie in `ledger/*.jsonl`. Each process appends to files with
a random name, so that no two processes, also of two hosts, share one. Lines that a killed process
left unfinished do not count.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated

import msgspec

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rstore.files.process_identity import host_name, process_token
from s2rstore.files.store_files import LocalFiles, StoreFiles

_ARRAYS = f"{layout.LEDGER}/arrays"
_COMPACTED = f"{layout.LEDGER}/compacted.jsonl"
_MAX_LINE = 65_536
_MAX_FILE = 2 << 30
"""Bytes of the file of one process, about 8 million entries."""


class LedgerEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A finished file: `key` names the work unit, `path` the file inside the store.

    `environment` is what computed it; None for files that were not computed.
    """

    key: str
    path: str
    bytes: Annotated[int, msgspec.Meta(ge=0)]
    checksum: Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{64}\Z")]
    count: Annotated[int, msgspec.Meta(ge=0)]
    environment: ComputeEnvironment | None = None


_DECODER = msgspec.json.Decoder(LedgerEntry)


def generation_file(generation: int) -> str:
    """The ledger file with an entry for every file of a generation, which `s2r push` writes.

    Servers that list no files are read by it.
    """
    return f"{layout.LEDGER}/generation-{generation:06d}.jsonl"


class LedgerReader:
    """Reads the ledger of a store, wherever that is kept."""

    def __init__(self, files: StoreFiles) -> None:
        self._store = files

    def entries(self) -> Iterator[LedgerEntry]:
        """Every entry that was completely written, in no particular order."""
        return self._parsed(self._files())

    def entries_in(self, files: Iterable[str]) -> Iterator[LedgerEntry]:
        """Every entry of some files of the ledger, given by their paths inside the store."""
        return self._parsed(files)

    def array_entries(self, array_key: str) -> dict[str, list[LedgerEntry]]:
        """The entries of the arrays of one key, given as RUN/KEY, by file."""
        run, _, key = array_key.partition("/")
        folder = f"{_ARRAYS}/{run}"
        files = [p for p in self._files_in(folder) if p.startswith(f"{folder}/{key}.")]
        return _by_path(self._parsed(files))

    def by_path(self) -> dict[str, list[LedgerEntry]]:
        """All entries by file; a file that was written several times has several."""
        return _by_path(self.entries())

    def unreadable_lines(self) -> int:
        """The number of lines without an entry: unfinished by a killed process, or damaged."""
        return sum(_parsed(line) is None for line in self._lines(self._files()))

    def _parsed(self, files: Iterable[str]) -> Iterator[LedgerEntry]:
        for line in self._lines(files):
            entry = _parsed(line)
            if entry is not None:
                yield entry

    def _lines(self, files: Iterable[str]) -> Iterator[bytes]:
        for name in files:
            size = 0
            with self._store.stream(name) as file:
                while line := file.readline(_MAX_LINE):  # pieces of a longer line do not parse
                    size += len(line)
                    if size > _MAX_FILE:
                        where = self._store.path / name
                        raise RequestError(f"{where}: over {_MAX_FILE} bytes; restore the ledger")
                    if line != b"\n":
                        yield line.rstrip(b"\n")

    def _files(self) -> list[str]:
        return [f for name in (layout.LEDGER, *self._run_folders()) for f in self._files_in(name)]

    def _run_folders(self) -> list[str]:
        entries = self._store.names(_ARRAYS)
        return [entry.path for entry in entries if entry.kind == "folder"]

    def _files_in(self, folder: str) -> list[str]:
        entries = self._store.names(folder)
        return [e.path for e in entries if e.name.endswith(".jsonl") and e.kind in ("file", "link")]

    def proves(self, entries: list[LedgerEntry]) -> bool:
        """Whether one of a file's entries states its size and checksum.

        Raises LinkError where the path leads through a symbolic link.
        """
        if not self.states_size(entries):
            return False
        try:
            checksum = self._store.sha256(entries[0].path)
        except OSError:
            return False
        return any(entry.checksum == checksum for entry in entries)

    def states_size(self, entries: list[LedgerEntry]) -> bool:
        """Whether the file of some entries exists and one of them states its size."""
        try:
            size = self._store.size(entries[0].path) if entries else None
        except OSError:
            return False
        return any(entry.bytes == size for entry in entries)


class Ledger(LedgerReader):
    """The ledger of a store in a folder: reads all entries, adds those of this process."""

    def __init__(self, root: Path) -> None:
        super().__init__(LocalFiles(root))
        self._root = root

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
        self._append(f"{layout.LEDGER}/{host_name()}-{process_token()}.jsonl", entries)

    def add_array_entries(self, array_key: str, entries: Iterable[LedgerEntry]) -> None:
        """Record complete and durable files of the arrays of one key, given as RUN/KEY."""
        self._append(f"{_ARRAYS}/{array_key}.{host_name()}-{process_token()}.jsonl", entries)

    def _append(self, name: str, entries: Iterable[LedgerEntry]) -> None:
        lines = "".join(map(_line, entries))
        atomic_writes.append_lines(self._root, name, lines.encode())

    def remove_entries(self, removed: set[str]) -> None:
        """Remove the entries of removed files, given by their paths inside the store.

        Only for the holder of both the compute lock and the publish lock of the store: processes
        add lines under the one or the other.
        """
        for folder in self._run_folders():
            for name in self._files_in(folder):
                self._rewrite([name], name, removed)
            if not safe_files.names(self._root, folder):
                atomic_writes.remove(self._root, folder)
        self._rewrite(self._files_in(layout.LEDGER), _COMPACTED, removed)

    def _rewrite(self, old: list[str], new: str, removed: set[str]) -> None:
        """Replace files by one without the removed entries, or by none."""
        entries = list(self._parsed(old))
        kept = [entry for entry in entries if entry.path not in removed]
        if old == [new] and len(kept) == len(entries):
            return
        if kept:
            atomic_writes.write(self._root, new, "".join(map(_line, kept)).encode())
        for path in old:
            if path != new or not kept:
                atomic_writes.remove(self._root, path)


def _by_path(entries: Iterable[LedgerEntry]) -> dict[str, list[LedgerEntry]]:
    grouped: dict[str, list[LedgerEntry]] = {}
    for entry in entries:
        grouped.setdefault(entry.path, []).append(entry)
    return grouped


def _line(entry: LedgerEntry) -> str:
    return msgspec.json.encode(entry).decode() + "\n"


def _parsed(line: bytes) -> LedgerEntry | None:
    try:
        return _DECODER.decode(line)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None
