"""Write and validate the `zarr.json` of an array, in the one form that a store holds.

An array is Zarr format 3, cut along its first axis into shards and these into chunks, each chunk
compressed by Blosc with zstd. A document is read by building the one that belongs to its shape,
type, shard and chunk size and attributes, and comparing: other codecs, filters, data types, fill
values and format 2 are refused, and so are sizes beyond the limits below, before anything is
allocated.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.documents import parse_json
from s2rstore.geometry.map_grid import AGGREGATES

DATA_TYPES = ("uint8", "uint16", "float16", "float32", "float64")
ATTRIBUTES = ("method", "aggregates")
DOCUMENT_BYTES = 65_536
CHUNK_BYTES = 256 * 1024
ITEM_BYTES = 64 * 2**20
VECTOR_LENGTH = 65_536
"""Values of one row of a two-dimensional array."""

_KEPT_BYTES = 4_096
"""Longer documents are parsed each time."""
_ROWS = 2**31 - 1
_SHARD_CHUNKS = 2**20
_TEXT = 1_000
_DIMENSIONS = 5


@dataclass(frozen=True, slots=True)
class Layout:
    """Shape (rows first), type and the rows of one shard; `rows_per_chunk` divides it.

    Shard 5 is the file `c.5.0` in the array's folder, with a 0 for each further axis.
    """

    shape: tuple[int, ...]
    dtype: str
    shard_rows: int
    rows_per_chunk: int

    @property
    def shards(self) -> int:
        return -(-self.shape[0] // self.shard_rows)

    @property
    def shard_chunks(self) -> int:
        return self.shard_rows // self.rows_per_chunk

    @property
    def item_bytes(self) -> int:
        """Bytes of one row."""
        size = np.dtype(self.dtype).itemsize
        for length in self.shape[1:]:
            size *= length
        return size

    @property
    def chunk_bytes(self) -> int:
        return self.rows_per_chunk * self.item_bytes


def shuffle(dtype: str) -> str:
    """The Blosc filter that suits a data type."""
    kind = np.dtype(dtype)
    return "bitshuffle" if kind.kind == "u" and kind.itemsize > 1 else "shuffle"


def document(layout: Layout, attributes: dict[str, Any]) -> bytes:
    """The content of `zarr.json`."""
    return json.dumps(_document(layout, attributes), indent=2).encode()


def _document(layout: Layout, attributes: dict[str, Any]) -> dict[str, Any]:
    item = list(layout.shape[1:])
    dtype = np.dtype(layout.dtype)
    endian = {"name": "bytes", "configuration": {"endian": "little"}}
    blosc = {"typesize": dtype.itemsize, "cname": "zstd", "clevel": 3,
             "shuffle": shuffle(layout.dtype), "blocksize": 0}  # fmt: skip
    sharding = {
        "chunk_shape": [layout.rows_per_chunk, *item],
        "codecs": [
            endian if dtype.itemsize > 1 else {"name": "bytes"},
            {"name": "blosc", "configuration": blosc},
        ],
        "index_codecs": [endian, {"name": "crc32c"}],
        "index_location": "end",
    }
    return {
        "shape": list(layout.shape),
        "data_type": layout.dtype,
        "chunk_grid": {
            "name": "regular",
            "configuration": {"chunk_shape": [layout.shard_rows, *item]},
        },
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": 0 if dtype.kind == "u" else 0.0,
        "codecs": [{"name": "sharding_indexed", "configuration": sharding}],
        "attributes": attributes,
        "zarr_format": 3,
        "node_type": "array",
        "storage_transformers": [],
    }


def parse_document(content: bytes, where: str) -> tuple[Layout, dict[str, str]]:
    """Layout and attributes of a `zarr.json`. RequestError names the array and the difference."""
    try:
        layout, attributes = (_parsed if len(content) > _KEPT_BYTES else _parsed_once)(content)
    except RequestError as error:
        raise _refused(where, str(error)) from error
    return layout, dict(attributes)


def _parsed(content: bytes) -> tuple[Layout, Mapping[str, str]]:
    """Layout and attributes; RequestError says why they are refused."""
    try:
        stored = parse_json(content, "")
    except RequestError as error:
        raise RequestError(str(error).removeprefix(": ")) from error
    try:
        layout, attributes = _layout(stored), _attributes(stored["attributes"])
    except (ValueError, TypeError, KeyError, IndexError, RecursionError) as error:
        raise RequestError(f"{type(error).__name__}: {error}") from error
    expected = _document(layout, attributes)
    for key in expected.keys() | stored.keys():
        if _text(stored.get(key)) != _text(expected.get(key)):
            raise RequestError(f"unexpected {key}")
    _check_sizes(layout)
    return layout, attributes


_parsed_once = lru_cache(4096)(_parsed)
"""Arrays of one shape and kind have one content, whatever their number."""


def _layout(stored: Any) -> Layout:
    if stored["zarr_format"] != 3 or stored["node_type"] != "array":
        raise ValueError("no array of Zarr format 3")
    shape = _sizes(stored["shape"], least=0)
    grid = stored["chunk_grid"]["configuration"]["chunk_shape"]
    chunks = stored["codecs"][0]["configuration"]["chunk_shape"]
    if stored["data_type"] not in DATA_TYPES:
        raise ValueError(f"data type {str(stored['data_type'])[:40]!r}")
    shard_rows, rows_per_chunk = _sizes(grid, least=1)[0], _sizes(chunks, least=1)[0]
    return Layout(shape, stored["data_type"], shard_rows, rows_per_chunk)


def _sizes(shape: Any, least: int) -> tuple[int, ...]:
    if not isinstance(shape, list) or not 1 <= len(shape) <= _DIMENSIONS:
        raise ValueError(f"a shape is a list of 1 to {_DIMENSIONS} sizes")
    for number, size in enumerate(shape):
        if type(size) is not int or not (least if number == 0 else 1) <= size <= _ROWS:
            raise ValueError(f"a size of {str(size)[:40]}")
    return tuple(shape)


def _attributes(attributes: Any) -> dict[str, str]:
    for name, value in attributes.items():
        if name not in ATTRIBUTES or not isinstance(value, str) or len(value) > _TEXT:
            raise ValueError(f"attribute {name[:40]!r}")
        if name == "aggregates" and value != ",".join(AGGREGATES):
            raise ValueError(f"aggregates {value[:40]!r}")
    return dict(attributes)


def _text(value: Any) -> str:
    """Equal texts for equal values of equal types: JSON distinguishes 1, 1.0 and true."""
    return json.dumps(value, sort_keys=True)


def _check_sizes(layout: Layout) -> None:
    item = layout.item_bytes
    if item > ITEM_BYTES or (len(layout.shape) == 2 and layout.shape[1] > VECTOR_LENGTH):
        raise RequestError(f"{item} bytes a row")
    if layout.shard_rows % layout.rows_per_chunk:
        raise RequestError("its chunks do not divide its shards")
    if layout.chunk_bytes > max(CHUNK_BYTES, item):
        raise RequestError(f"{layout.chunk_bytes} bytes a chunk")
    if layout.shard_chunks > _SHARD_CHUNKS:
        raise RequestError(f"{layout.shard_chunks} chunks a shard")


def _refused(where: str, why: str) -> RequestError:
    reason = " ".join(why.split())[:200]
    return RequestError(f"{where}: metadata that this program does not write ({reason}); "
                        "do not trust it, or run `s2r verify`")  # fmt: skip
