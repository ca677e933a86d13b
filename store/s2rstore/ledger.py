"""The ledger: one JSON line per finished work unit; nothing else proves that a unit is done.

Each writing process appends to a file of its own, so no two processes share one. A line that a
killed process left half-written is not a line.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from s2rstore import layout


@dataclass(frozen=True, slots=True)
class Entry:
    """A finished file: `key` names the work unit, `path` the file inside the store."""

    key: str
    path: str
    bytes: int
    checksum: str
    count: int


class Ledger:
    """All entries of a store, and the door through which this process adds its own."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._folder = root / layout.LEDGER

    def entries(self) -> Iterator[Entry]:
        """Every entry that was completely written, in no particular order."""
        for path in sorted(self._folder.glob("*.jsonl")):
            if not path.is_file():
                continue
            for line in path.read_bytes().split(b"\n"):
                entry = _parsed(line)
                if entry is not None:
                    yield entry

    def add(self, key: str, files: list[tuple[str, int]]) -> None:
        """Record a unit whose files, given as (path inside the store, count), are complete.

        The files are made durable first, then the lines.
        """
        lines = []
        for relative, count in files:
            path = self._root / relative
            layout.sync_file(path)
            layout.sync_folder(path.parent)
            entry = Entry(key, relative, path.stat().st_size, layout.file_sha256(path), count)
            lines.append(json.dumps(asdict(entry), separators=(",", ":")) + "\n")
        self._folder.mkdir(exist_ok=True)
        own = self._folder / f"{socket.gethostname()}-{os.getpid()}.jsonl"
        with own.open("ab") as file:
            if file.tell() and not _ends_with_newline(own):
                file.write(b"\n")
            file.write("".join(lines).encode())
            file.flush()
            os.fsync(file.fileno())
        layout.sync_folder(self._folder)

    def by_path(self) -> dict[str, list[Entry]]:
        """Entries grouped by file: a file that was made again has several."""
        grouped: dict[str, list[Entry]] = {}
        for entry in self.entries():
            grouped.setdefault(entry.path, []).append(entry)
        return grouped

    def proves(self, entries: list[Entry]) -> bool:
        """Whether one of the entries of a file tells the size and checksum of what lies there."""
        if not entries:
            return False
        path = self._root / entries[0].path
        try:
            size = path.stat().st_size
            if not any(entry.bytes == size for entry in entries):
                return False
            checksum = layout.file_sha256(path)
        except OSError:
            return False
        return any((entry.bytes, entry.checksum) == (size, checksum) for entry in entries)

    def forget(self, gone: set[str]) -> None:
        """Drop the entries of files that were removed, by their paths inside the store.

        Only for the holder of the store's compute lock: other processes must not be adding.
        """
        kept = [entry for entry in self.entries() if entry.path not in gone]
        lines = "".join(json.dumps(asdict(e), separators=(",", ":")) + "\n" for e in kept)
        old = sorted(self._folder.glob("*.jsonl"))
        layout.write_atomic(self._folder / "compacted.jsonl", lines.encode())
        for path in old:
            if path.name != "compacted.jsonl":
                path.unlink()


def _parsed(line: bytes) -> Entry | None:
    try:
        return Entry(**json.loads(line))
    except (ValueError, TypeError, RecursionError):
        return None


def _ends_with_newline(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"
