"""The files of a store on a server, read by HTTP or S3 requests; nothing is ever written there.

A file is read in pieces, so that one instance costs one or two small requests. Shards do not
change, so pieces that were read are kept in memory.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from io import BufferedIOBase, BufferedReader
from pathlib import Path
from typing import Any

from s2rstore.errors import DamagedStoreError, RequestError
from s2rstore.files import layout, safe_files
from s2rstore.files.ledger import LedgerReader, generation_file
from s2rstore.files.safe_files import FolderEntry, Kind
from s2rstore.files.store_files import OpenFile, Stamp, StoreFiles
from s2rstore.lru_cache import LruCache
from s2rstore.remote.local_copies import LocalCopies
from s2rstore.remote.object_client import ObjectClient, ObjectFacts
from s2rstore.remote.store_url import StoreUrl
from s2rstore.remote.web_client import WebClient

BLOCK_BYTES = 4 * 2**20
"""Bytes of one request for a part of a large file."""
_CACHED_BYTES = 64 * 2**20
_LARGEST_CACHED = 8 * 2**20


class RemoteFiles(StoreFiles):
    """The files of the store at a URL; any thread may read them."""

    is_remote = True

    def __init__(self, url: StoreUrl) -> None:
        self.path = url
        self.client = ObjectClient(url) if url.scheme == "s3" else WebClient(url)
        self._pieces = LruCache(_CACHED_BYTES, lambda piece: len(piece[0]))
        self._copies = LocalCopies(str(url), self._blocks)
        self._stamps: dict[str, Stamp] = {}

    @property
    def absence(self) -> str:
        return f"not a store (no {layout.CURRENT} there); check the URL"

    @contextmanager
    def open(self, relative: str) -> Iterator[OpenFile]:
        yield _OpenRemoteFile(self, self._checked(relative))

    def stream(self, relative: str) -> BufferedIOBase:
        return BufferedReader(_BlockReader(self._blocks(relative)), BLOCK_BYTES)

    def read(self, relative: str, limit: int) -> bytes:
        return self.client.whole(self._checked(relative), limit)[0]

    def size(self, relative: str) -> int:
        return self.client.head(self._checked(relative)).bytes

    def kind(self, relative: str) -> Kind | None:
        """As `StoreFiles.kind`; folders of object stores do not exist by themselves."""
        try:
            self.client.head(self._checked(relative))
        except FileNotFoundError:
            return None
        return "file"

    def names(self, relative: str) -> list[FolderEntry]:
        folder = self._checked(relative)
        if self._listed is None:
            found = self.client.listed(folder, deeply=False)
            entries = [_entry(path, facts) for path, facts in found]
        else:
            prefix = f"{folder}/" if folder else ""
            entries, folders = [], set()
            for path, size in self._listed.items():
                name, slash, _ = path.removeprefix(prefix).partition("/")
                if path.startswith(prefix) and slash:
                    folders.add(prefix + name)
                elif path.startswith(prefix):
                    entries.append(FolderEntry(path, "file", size))
            entries += [FolderEntry(path, "folder", 0) for path in folders]
        return sorted(entries, key=lambda entry: entry.path)

    def walk(self, relative: str = "") -> Iterator[FolderEntry]:
        folder = self._checked(relative)
        if self._listed is None:
            for path, facts in self.client.listed(folder, deeply=True):
                yield _entry(path, facts)
            return
        prefix = f"{folder}/" if folder else ""
        for path, size in sorted(self._listed.items()):
            if path.startswith(prefix):
                yield FolderEntry(path, "file", size)

    @property
    def lists_files(self) -> bool:
        """Whether the server lists its files, or `s2r push` has left a list of them."""
        return self._listed != {}

    @cached_property
    def _listed(self) -> dict[str, int] | None:
        """Sizes of files by path, from the list that `s2r push` writes.

        None where the server lists them itself, empty where nothing does.
        """
        name = generation_file(layout.current_of(self).generation)
        try:
            size = self.size(name)
        except FileNotFoundError:
            return None if self.client.can_list else {}
        entries = LedgerReader(self).entries_in([name])
        return {entry.path: entry.bytes for entry in entries} | {name: size}

    def stamp(self, relative: str) -> Stamp | None:
        try:
            facts = self.client.head(self._checked(relative))
        except FileNotFoundError:
            return None
        version = int(hashlib.sha256(facts.etag.encode()).hexdigest()[:15], 16)
        return version, facts.modified_ns, facts.bytes

    def index_file(self, relative: str, sha256: str | None, size: int | None) -> Path:
        try:
            return self._copies.index(self._checked(relative), sha256, size)
        except FileNotFoundError as error:
            message = f"{self.path / relative}: missing; run `s2r verify`"
            raise DamagedStoreError(message) from error

    def local_file(self, relative: str, sha256: str | None = None, size: int | None = None) -> Path:
        name = self._checked(relative)
        try:
            if sha256 is None:
                stamp = self.stamp(name)
                if stamp is not None and self._stamps.get(name) == stamp:
                    return self._copies.path(name)
                path = self._copies.file(name, None, size)
                self._stamps |= {} if stamp is None else {name: stamp}
                return path
            return self._copies.file(name, sha256, size)
        except FileNotFoundError:
            path = self._copies.path(name)
            path.unlink(missing_ok=True)  # that of an earlier time
            return path

    def _checked(self, relative: str) -> str:
        """The path of a file; RequestError where it would lead out of the store."""
        return "/".join(safe_files.parts_of(self.path, relative))

    def _blocks(self, relative: str) -> Iterator[bytes]:
        """The content of a file in blocks, each of which is one request."""
        name, offset, known = self._checked(relative), 0, None
        while known is None or offset < known.bytes:
            block, facts = self.client.piece(name, offset, BLOCK_BYTES)
            known = known or facts
            self._require_same(name, known, facts)
            if known.bytes and not block:
                raise DamagedStoreError(f"{self.path / name}: it ends early; run `s2r verify`")
            offset += len(block)
            yield block

    def piece(self, name: str, start: int, length: int) -> tuple[bytes, ObjectFacts]:
        """A piece of a file that does not change, from memory if it was read before."""
        key = name, start, length
        if length > _LARGEST_CACHED:
            return self.client.piece(*key)
        return self._pieces.get(key, lambda: self.client.piece(*key))

    def forget_pieces(self) -> None:
        self._pieces.clear()

    def _require_same(self, name: str, known: ObjectFacts, facts: ObjectFacts) -> None:
        """Raise RequestError where two answers are those of different contents."""
        if (facts.bytes, facts.etag) != (known.bytes, known.etag):
            self._pieces.drop(lambda key: isinstance(key, tuple) and key[0] == name)
            where = self.path / name
            raise RequestError(f"{where}: was replaced while it was read; try again")


class _OpenRemoteFile:
    """A file of which pieces are requested when they are needed."""

    def __init__(self, files: RemoteFiles, name: str) -> None:
        self._files, self._name = files, name
        self._facts: ObjectFacts | None = None

    def tail(self, length: int) -> tuple[bytes, int]:
        content, self._facts = self._files.piece(self._name, -length, length)
        return content, self._facts.bytes

    def piece(self, offset: int, length: int) -> bytes:
        content, facts = self._files.piece(self._name, offset, length)
        if self._facts is not None:
            self._files._require_same(self._name, self._facts, facts)
        return content


class _BlockReader(io.RawIOBase):
    """A stream of the bytes of blocks."""

    def __init__(self, blocks: Iterator[bytes]) -> None:
        self._blocks = blocks
        self._rest = memoryview(b"")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        if not self._rest:
            self._rest = memoryview(next(self._blocks, b""))
        count = min(len(buffer), len(self._rest))
        buffer[:count] = self._rest[:count]
        self._rest = self._rest[count:]
        return count


def _entry(path: str, facts: ObjectFacts | None) -> FolderEntry:
    return FolderEntry(path, "folder" if facts is None else "file", facts.bytes if facts else 0)
