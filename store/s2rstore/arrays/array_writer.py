"""Write the Zarr arrays of a store: created once, then one whole shard at a time.

A shard is a file of Blosc chunks, one behind the other, and an index of their places, as the
sharding codec of Zarr format 3 describes it. The chunks of a shard can be compressed in different
processes and are joined without decompressing them, for which zarr has no function.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import zarr_metadata
from s2rstore.arrays.stored_array import (
    ABSENT,
    METADATA,
    StoredArray,
    codec,
    open_read,
    place_of,
    shard_name,
)
from s2rstore.arrays.zarr_metadata import CHUNK_BYTES, Layout
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, safe_files

SHARD_ROWS = 16_384
"""Rows of a shard, so that an array of a million instances has 62 files."""


def plan_layout(
    rows: int, item: tuple[int, ...], dtype: str, shard_rows: int, unit_rows: int | None = None
) -> Layout:
    """The layout of an array of `rows` items, with chunks of about 256 kB.

    No chunk holds rows of two units of `unit_rows` rows, by default of a shard; `shard_rows` is a
    multiple of that.
    """
    unit_rows = unit_rows or shard_rows
    requested = _chunk_rows(unit_rows, item, dtype)
    per_chunk = next(n for n in range(requested, 0, -1) if unit_rows % n == 0)
    return Layout((rows, *item), dtype, shard_rows, per_chunk)


def plan_whole(rows: int, item: tuple[int, ...], dtype: str) -> Layout:
    """The layout of an array of `rows` items in one shard, with chunks of about 256 kB."""
    per_chunk = _chunk_rows(rows, item, dtype)
    return Layout((rows, *item), dtype, max(1, -(-rows // per_chunk)) * per_chunk, per_chunk)


def _chunk_rows(most: int, item: tuple[int, ...], dtype: str) -> int:
    size = int(np.dtype(dtype).itemsize * np.prod(item, dtype=np.int64))
    return max(1, min(most, CHUNK_BYTES // max(size, 1)))


def create(
    path: Path, layout: Layout, attributes: dict[str, Any] | None = None, root: Path | None = None
) -> StoredArray:
    """Create an empty array, or open the existing one of the same shape and type.

    The existing one may be cut into other shards and chunks. `root` is the store that `path` lies
    in; see `open_read`. Raises RequestError where another array lies there: stored arrays are never
    rewritten.
    """
    root, relative = place_of(path, root)
    document = f"{relative}/{METADATA}"
    if safe_files.kind(root, document) is None:
        content = zarr_metadata.document(layout, attributes or {})
        zarr_metadata.parse_document(content, str(path))
        atomic_writes.write(root, document, content)
    array = open_read(path, root)
    if (array.shape, array.layout.dtype) != (layout.shape, layout.dtype):
        raise RequestError(f"{path}: holds another array; run `s2r prune`, or remove it")
    return array


@dataclass(frozen=True, slots=True)
class WrittenFile:
    """A complete file of a store: its path inside the store, size and SHA-256."""

    path: str
    bytes: int
    sha256: str


def encode_chunks(layout: Layout, rows: NDArray[Any]) -> list[bytes]:
    """Compress rows that begin with a chunk; the last chunk is filled up with zeros."""
    blosc, size = codec(layout.dtype), layout.rows_per_chunk
    rows = np.ascontiguousarray(rows, dtype=layout.dtype)
    chunks = []
    for start in range(0, len(rows), size):
        chunk = rows[start : start + size]
        if len(chunk) < size:
            filled = np.zeros((size, *rows.shape[1:]), dtype=rows.dtype)
            filled[: len(chunk)] = chunk
            chunk = filled
        chunks.append(bytes(blosc.encode(chunk)))
    return chunks


def write_chunks(
    root: Path, folder: str, layout: Layout, shard: int, rows: int, chunks: Iterable[bytes]
) -> WrittenFile:
    """Write a shard of compressed chunks durably, as `write_unnamed` and `name_shard` do."""
    unnamed = write_unnamed(root, folder, layout, shard, rows, chunks)
    name_shard(root, unnamed)
    return unnamed.written


@dataclass(frozen=True, slots=True)
class UnnamedShard:
    """A written shard that has a temporary name: its path inside the store, and the final file."""

    path: str
    written: WrittenFile


def write_unnamed(
    root: Path, folder: str, layout: Layout, shard: int, rows: int, chunks: Iterable[bytes]
) -> UnnamedShard:
    """Write a shard of compressed chunks, which are read one after the other.

    `folder` is the array's inside `root`, `rows` how many rows the shard holds. Raises ValueError
    where there are more or fewer chunks than that. `name_shard` makes it a shard of the array.
    """
    digest, sizes = hashlib.sha256(), list[int]()
    expected = -(-rows // layout.rows_per_chunk)

    def content() -> Iterator[bytes]:
        for chunk in chunks:
            sizes.append(len(chunk))
            digest.update(chunk)
            yield chunk
        if len(sizes) != expected:
            raise ValueError(f"{folder}: shard {shard}: {len(sizes)} chunks, not {expected}")
        index = _index(sizes, layout.shard_chunks)
        digest.update(index)
        sizes.append(len(index))
        yield index

    name = f"{folder}/{shard_name(layout, shard)}"
    path = atomic_writes.write_attempt(root, name, content(), durable=False, create_folder=True)
    return UnnamedShard(path, WrittenFile(name, sum(sizes), digest.hexdigest()))


def name_shard(root: Path, shard: UnnamedShard) -> None:
    """Give a shard its name durably; for any thread."""
    atomic_writes.flush_and_rename(root, shard.path, shard.written.path)


def _index(sizes: Sequence[int], count: int) -> bytes:
    """The index of a shard of `count` chunks, those of `sizes` bytes first, and its checksum."""
    import google_crc32c

    places = np.full((count, 2), ABSENT, dtype="<u8")
    places[: len(sizes), 1] = sizes
    places[: len(sizes), 0] = np.cumsum([0, *sizes[:-1]]) if sizes else 0
    content = places.tobytes()
    return content + int(google_crc32c.value(content)).to_bytes(4, "little")


def write_shard(
    path: Path, shard: int, rows: NDArray[Any], root: Path | None = None
) -> WrittenFile:
    """Write shard number `shard` completely and durably.

    `rows` has as many rows as the shard holds in this array (fewer in the last one).
    """
    array = open_read(path, root)
    expected = (array.rows_in(shard), *array.shape[1:])
    if rows.shape != expected:
        raise ValueError(f"{path}: shard {shard} holds {expected[0]} rows, got {rows.shape}")
    root, folder = place_of(path, root)
    return write_shard_of(root, folder, array.layout, shard, rows)


def write_shard_of(
    root: Path, folder: str, layout: Layout, shard: int, rows: NDArray[Any]
) -> WrittenFile:
    """Write a shard of an array that is created when its length is known.

    `folder` is the array's inside `root`. The length in `layout` is not used. All shards but the
    last have `layout.shard_rows` rows.
    """
    return write_chunks(root, folder, layout, shard, len(rows), encode_chunks(layout, rows))
