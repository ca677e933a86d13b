"""Read the Zarr arrays of a store row by row; `array_writer` writes them.

Chunks are small for random reads of one instance; a shard is one file of many chunks. Only the form
of `zarr_metadata` is read, by `StoreFiles`: no link is followed, a missing shard is an error and
never zeros, and no chunk takes more memory than the metadata of its array states. zarr cannot be
configured to do so, takes longer to import, and needs three times as long to read one instance.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import zarr_metadata
from s2rstore.arrays.row_array import RowArray
from s2rstore.arrays.zarr_metadata import Layout
from s2rstore.errors import DamagedStoreError
from s2rstore.files import safe_files
from s2rstore.files.layout import CURRENT
from s2rstore.files.store_files import LocalFiles, OpenFile, StoreFiles

METADATA = "zarr.json"

BLOSC_HEADER = 16
_BLOSC_ZSTD = 4
INDEX_CHECKSUM = 4
ABSENT = 2**64 - 1
_READ_BYTES = 16 * 2**20
_PARALLEL_CHUNKS = 8
_PARALLEL_BYTES = 64 * 1024


def place_of(path: Path, root: Path | None) -> tuple[Path, str]:
    """The folder below which no link is followed, and the array's path in it.

    Without `root` that is the store that the path lies in, or else the closest existing folder.
    """
    if root is None:
        above = path.parents
        stores = (folder for folder in above if (folder / CURRENT).is_file())
        root = next(stores, None) or next(folder for folder in above if folder.is_dir())
    return root, path.relative_to(root).as_posix()


class StoredArray(RowArray):
    """An array of a store in one folder."""

    def __init__(
        self,
        files: StoreFiles,
        relative: str,
        layout: Layout,
        attributes: Mapping[str, str],
        sha256: str,
    ) -> None:
        self._files = files
        self._relative = relative
        self.layout = layout
        self.attrs = dict(attributes)
        self.metadata_sha256 = sha256
        self.shape = layout.shape
        self.dtype = np.dtype(layout.dtype)

    @property
    def path(self) -> Path:
        return self._files.path / self._relative

    @property
    def block_rows(self) -> int:
        return self.layout.rows_per_chunk

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        """Rows [start, stop), which lie within the array."""
        self._check_range(start, stop)
        values = np.empty((stop - start, *self.shape[1:]), dtype=self.dtype)
        shard_rows = self.layout.shard_rows
        for shard in range(start // shard_rows, -(-stop // shard_rows)) if stop > start else ():
            base = shard * shard_rows
            low, high = max(start, base), min(stop, base + shard_rows)
            self._read(shard, low - base, high - base, values[low - start : high - start])
        return values

    def file(self, shard: int) -> str:
        """A shard's file, inside the root that the array was opened with."""
        return f"{self._relative}/{shard_name(self.layout, shard)}"

    def rows_in(self, shard: int) -> int:
        """How many rows a shard holds; fewer in the last one."""
        return min(self.layout.shard_rows, self.shape[0] - shard * self.layout.shard_rows)

    def check(self, shard: int) -> None:
        """Check a shard's size, index and chunk headers against the metadata, without decoding."""
        name = self.file(shard)
        where = self._files.path / name
        chunks = -(-self.rows_in(shard) // self.layout.rows_per_chunk)
        with _reading(where), self._files.open(name) as file:
            index = self._index(file, where)[:chunks]
            _check_places(index, self.layout, where)
            for first in range(0, chunks, self._chunks_at_once):
                _parts(file, index[first : first + self._chunks_at_once], self.layout, where)

    def chunks(self, first: int, last: int) -> Iterator[bytes]:
        """The compressed chunks [first, last), counted over all shards."""
        per_shard = self.layout.shard_chunks
        while first < last:
            shard, begin = divmod(first, per_shard)
            stop = min(per_shard, begin + last - first, begin + self._chunks_at_once)
            name = self.file(shard)
            where = self._files.path / name
            with _reading(where), self._files.open(name) as file:
                index = self._index(file, where)
                yield from map(bytes, _parts(file, index[begin:stop], self.layout, where))
            first += stop - begin

    @property
    def _chunks_at_once(self) -> int:
        return max(1, _READ_BYTES // self.layout.chunk_bytes)

    def _read(self, shard: int, low: int, high: int, into: NDArray[Any]) -> None:
        """Rows [low, high) of a shard into `into`."""
        name = self.file(shard)
        where = self._files.path / name
        per_chunk = self.layout.rows_per_chunk
        first, last = low // per_chunk, -(-high // per_chunk)
        at_once = self._chunks_at_once

        def decode(chunk: int, part: memoryview) -> None:
            base = chunk * per_chunk
            start, stop = max(low, base), min(high, base + per_chunk)
            self._decode(part, start - base, stop - base, into[start - low : stop - low], where)

        with _reading(where), self._files.open(name) as file:
            index = self._index(file, where)
            for group in range(first, last, at_once):
                sizes = index[group : min(group + at_once, last)]
                parts = _parts(file, sizes, self.layout, where)
                numbers = range(group, group + len(parts))
                if len(parts) < _PARALLEL_CHUNKS or self.layout.chunk_bytes < _PARALLEL_BYTES:
                    for chunk, part in zip(numbers, parts, strict=True):
                        decode(chunk, part)
                else:
                    list(_decoders().map(decode, numbers, parts))

    def _index(self, file: OpenFile, where: Path) -> NDArray[np.uint64]:
        """Offset and size of each chunk, (n, 2), within the shard's file."""
        import google_crc32c

        layout = self.layout
        length = 16 * layout.shard_chunks + INDEX_CHECKSUM
        most = layout.shard_chunks * (layout.chunk_bytes + BLOSC_HEADER) + length
        content, size = file.tail(length)
        if not length <= size <= most:
            raise _damaged(where, f"{size} bytes")
        stated = int.from_bytes(content[-INDEX_CHECKSUM:], "little")
        if len(content) != length or google_crc32c.value(content[:-INDEX_CHECKSUM]) != stated:
            raise _damaged(where, "the index does not fit its checksum")
        index = np.frombuffer(content, dtype="<u8", count=2 * layout.shard_chunks).reshape(-1, 2)
        known = index[(index != ABSENT).all(axis=1)]
        room = size - length
        if known.size and ((known > room).any() or (known.sum(axis=1) > room).any()):
            raise _damaged(where, "the index leads out of the file")
        return index

    def _decode(
        self, part: memoryview, start: int, stop: int, target: NDArray[Any], where: Path
    ) -> None:
        """Rows [start, stop) of a chunk into `target`."""
        if stop - start == self.layout.rows_per_chunk and target.flags.c_contiguous:
            _decompress(part, self.layout, target, where)
            return
        whole = np.empty((self.layout.rows_per_chunk, *self.shape[1:]), dtype=self.dtype)
        _decompress(part, self.layout, whole, where)
        target[...] = whole[start:stop]


def _decompress(
    chunk: bytes | memoryview, layout: Layout, target: NDArray[Any], where: Path
) -> None:
    try:
        codec(layout.dtype).decode(chunk, target)
    except (RuntimeError, ValueError, BufferError) as error:
        raise _damaged(where, str(error)) from error


@contextmanager
def _reading(where: Path) -> Iterator[None]:
    """Errors of the operating system as RequestErrors that name the shard."""
    try:
        yield
    except FileNotFoundError as error:
        message = f"{where}: missing; open the store again, or run `s2r verify`"
        raise DamagedStoreError(message) from error
    except OSError as error:
        reason = safe_files.error_text(error)
        message = f"{where}: cannot be read ({reason}); run `s2r verify`"
        raise DamagedStoreError(message) from error


@cache
def _decoders() -> ThreadPoolExecutor:
    """Threads that decompress the chunks of large reads."""
    return ThreadPoolExecutor(min(4, os.cpu_count() or 1), "decode")


def _parts(
    file: OpenFile, index: NDArray[np.uint64], layout: Layout, where: Path
) -> list[memoryview]:
    """The compressed bytes of neighbouring chunks, which lie one behind the other."""
    begin, end = _check_places(index, layout, where)
    content = memoryview(file.piece(begin, end - begin))
    if len(content) != end - begin:
        raise _damaged(where, "it ends early")
    parts = [content[offset - begin : offset - begin + size] for offset, size in index.tolist()]
    for part in parts:
        check_chunk(part, len(part), layout.chunk_bytes, where)
    return parts


def _check_places(index: NDArray[np.uint64], layout: Layout, where: Path) -> tuple[int, int]:
    """First byte and end of neighbouring chunks, each of which must follow the one before."""
    if (index == ABSENT).any():
        raise _damaged(where, "a chunk is missing")
    offsets, sizes = index[:, 0].tolist(), index[:, 1].tolist()
    behind = [offset + size for offset, size in zip(offsets, sizes, strict=True)]
    if max(sizes) > layout.chunk_bytes + BLOSC_HEADER or offsets[1:] != behind[:-1]:
        raise _damaged(where, "its chunks do not lie one behind the other")
    return offsets[0], behind[-1]


def check_chunk(header: memoryview | bytes, size: int, chunk_bytes: int, where: Path) -> None:
    """Refuse data whose Blosc header states another size than a chunk's, before decompression.

    `header` are the first bytes of a chunk of `size` bytes.
    """
    if len(header) < BLOSC_HEADER:
        raise _damaged(where, "a chunk is cut")
    total, packed = (int.from_bytes(header[at : at + 4], "little") for at in (4, 12))
    if header[2] >> 5 != _BLOSC_ZSTD or packed != size:
        raise _damaged(where, "a chunk is not compressed as Blosc with zstd")
    if total != chunk_bytes:
        raise _damaged(where, f"a chunk of {total} bytes instead of {chunk_bytes}")


def _damaged(where: Path, why: str) -> DamagedStoreError:
    return DamagedStoreError(f"{where}: damaged ({why}); run `s2r verify`")


@cache
def codec(dtype: str) -> Any:
    """The Blosc codec of the chunks of a data type."""
    from numcodecs import blosc

    blosc.use_threads = False
    mode = blosc.BITSHUFFLE if zarr_metadata.shuffle(dtype) == "bitshuffle" else blosc.SHUFFLE
    return blosc.Blosc("zstd", 3, mode, typesize=np.dtype(dtype).itemsize)


def open_read(path: Path, root: Path | None = None) -> StoredArray:
    """Open an array; `root` is the store that it lies in, by default the closest one above it.

    Raises RequestError where the array is missing, where a link leads to it, and where its
    metadata is not of the form that this module writes.
    """
    root, relative = place_of(path, root)
    return open_array(LocalFiles(root), relative)


def open_array(files: StoreFiles, relative: str) -> StoredArray:
    """Open an array of a store by its path there; raises RequestError as `open_read`."""
    path = files.path / relative
    try:
        content = files.read(f"{relative}/{METADATA}", zarr_metadata.DOCUMENT_BYTES)
    except FileNotFoundError as error:
        old = files.kind(f"{relative}/.zarray") is not None
        what = "an array of Zarr format 2, which is not read" if old else "no such array"
        raise DamagedStoreError(f"{path}: {what}; run `s2r verify`") from error
    except OSError as error:
        reason = safe_files.error_text(error)
        message = f"{path}: unreadable metadata ({reason}); run `s2r verify`"
        raise DamagedStoreError(message) from error
    layout, attributes = zarr_metadata.parse_document(content, str(path))
    return StoredArray(files, relative, layout, attributes, hashlib.sha256(content).hexdigest())


def read_rows(array: RowArray, start: int, stop: int) -> NDArray[Any]:
    """Rows [start, stop). RequestError where a shard's file is damaged or missing."""
    stop = min(stop, array.shape[0])
    return array.rows(min(start, stop), stop)


def shard_name(layout: Layout, shard: int) -> str:
    """The file of a shard within the folder of its array."""
    return ".".join(("c", str(shard), *["0"] * (len(layout.shape) - 1)))
