"""Zarr arrays of a store: how they are laid out, created once and written a whole shard at a time.

Chunks are small for random reads of one instance; a shard is one work unit's file, written by
one process. zarr is imported on first use, because the first screen needs none of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.layout import sync_file, sync_folder

if TYPE_CHECKING:
    import zarr

_UNREADABLE = (ValueError, TypeError, KeyError, AttributeError, RuntimeError, OSError)
_CHUNK_BYTES = 256 * 1024


@dataclass(frozen=True, slots=True)
class Layout:
    """Shape (rows first), type and the rows of one shard; `rows_per_chunk` divides it."""

    shape: tuple[int, ...]
    dtype: str
    shard_rows: int
    rows_per_chunk: int

    @property
    def shards(self) -> int:
        return -(-self.shape[0] // self.shard_rows)


def plan(rows: int, item: tuple[int, ...], dtype: str, shard_rows: int) -> Layout:
    """The layout of an array of `rows` items, with chunks of about 256 kB."""
    size = int(np.dtype(dtype).itemsize * np.prod(item, dtype=np.int64))
    wanted = max(1, min(shard_rows, _CHUNK_BYTES // max(size, 1)))
    per_chunk = next(n for n in range(wanted, 0, -1) if shard_rows % n == 0)
    return Layout((rows, *item), dtype, shard_rows, per_chunk)


def create(path: Path, layout: Layout, attributes: dict[str, Any] | None = None) -> None:
    """Make an empty array, or leave an equal one as it is.

    Raises RequestError where another array lies there: stored arrays are never rewritten.
    """
    import zarr
    from zarr.codecs import BloscCodec

    item = layout.shape[1:]
    if (path / "zarr.json").exists():
        found = zarr.open_array(path, mode="r")
        if found.shape != layout.shape or found.dtype != np.dtype(layout.dtype):
            raise RequestError(f"{path}: holds another array; run `s2r prune`, or remove it")
        return
    zarr.create_array(
        store=path,
        shape=layout.shape,
        dtype=layout.dtype,
        chunks=(layout.rows_per_chunk, *item),
        shards=(layout.shard_rows, *item),
        compressors=BloscCodec(cname="zstd", clevel=3, shuffle=_shuffle(layout.dtype)),
        fill_value=0,
        attributes=attributes or {},
    )
    sync_file(path / "zarr.json")
    for folder in (path, path.parent, path.parent.parent):
        sync_folder(folder)


def _shuffle(dtype: str) -> Any:
    kind = np.dtype(dtype)
    return "bitshuffle" if kind.kind == "u" and kind.itemsize > 1 else "shuffle"


def open_read(path: Path) -> zarr.Array[Any]:
    """Raises RequestError where the array is missing or its metadata cannot be read."""
    import zarr

    try:
        return zarr.open_array(path, mode="r")
    except FileNotFoundError as error:
        raise RequestError(f"{path}: no such array; run `s2r verify`") from error
    except _UNREADABLE as error:
        raise RequestError(f"{path}: unreadable metadata ({type(error).__name__})") from error


def read_rows(array: zarr.Array[Any], start: int, stop: int) -> NDArray[Any]:
    """Rows [start, stop).

    RequestError where a shard's file is damaged, or missing, which zarr would read as zeros.
    """
    rows_per_shard = array.shards[0] if array.shards else array.chunks[0]
    root = Path(str(array.store_path).removeprefix("file://"))
    for shard in range(start // rows_per_shard, -(-stop // rows_per_shard)):
        file = shard_file(root, shard, array.ndim)
        if not file.exists():
            raise RequestError(f"{file}: missing; open the store again, or run `s2r verify`")
    try:
        return np.asarray(array[start:stop])
    except _UNREADABLE as error:
        raise RequestError(f"{root}: damaged ({error}); run `s2r verify`") from error


def write_shard(path: Path, shard: int, rows: NDArray[Any]) -> Path:
    """Write shard number `shard` completely; gives the file that holds it.

    `rows` has as many rows as the shard holds in this array (fewer in the last one).
    """
    import zarr

    with zarr.config.set({"array.write_empty_chunks": True}):
        array = zarr.open_array(path, mode="r+")
        if array.shards is None:
            raise RequestError(f"{path}: not sharded")
        start = shard * array.shards[0]
        stop = min(start + array.shards[0], array.shape[0])
        if rows.shape != (stop - start, *array.shape[1:]):
            raise ValueError(f"{path}: shard {shard} holds {stop - start} rows, got {rows.shape}")
        array[start:stop] = rows
    return shard_file(path, shard, array.ndim)


def shard_file(path: Path, shard: int, ndim: int) -> Path:
    return path.joinpath("c", str(shard), *["0"] * (ndim - 1))
