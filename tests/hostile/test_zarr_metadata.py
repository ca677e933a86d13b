"""Arrays are opened only in the exact format that the store writes."""

import json
import struct
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st

import s2rstore
from s2rstore.arrays import array_writer, stored_array
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rstore.reader import Store

ARRAY = "runs.zarr/vanilla/key0/activation.real"


def _change(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    document = json.loads((path / "zarr.json").read_text())
    change(document)
    (path / "zarr.json").write_text(json.dumps(document, indent=2))


def _sharding(document: dict[str, Any]) -> dict[str, Any]:
    return document["codecs"][0]["configuration"]


def _read(root: Path) -> None:
    with s2rstore.open(root) as store:
        store.heatmap("vanilla", "activation", "real", 0)


CHANGES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "another codec": lambda d: _sharding(d)["codecs"].append({"name": "vlen-utf8"}),
    "a numcodecs codec": lambda d: _sharding(d)["codecs"].append(
        {"name": "numcodecs.pickle", "configuration": {}}
    ),
    "big endian": lambda d: _sharding(d)["codecs"][0]["configuration"].update(endian="big"),
    "index at the start": lambda d: _sharding(d).update(index_location="start"),
    "no checksum": lambda d: _sharding(d)["index_codecs"].pop(),
    "a fill value": lambda d: d.update(fill_value=1.0),
    "objects": lambda d: d.update(data_type="object"),
    "more rows": lambda d: d["shape"].__setitem__(0, 41),
    "huge": lambda d: d.update(shape=[40, 2**20, 2**20, 4]),
    "a negative size": lambda d: d.update(shape=[-1, 4, 4, 4]),
    "other chunks": lambda d: _sharding(d)["chunk_shape"].__setitem__(0, 8),
    "no shards": lambda d: d.update(codecs=_sharding(d)["codecs"]),
    "another separator": lambda d: d["chunk_key_encoding"]["configuration"].update(separator="-"),
    "a transformer": lambda d: d["storage_transformers"].append({"name": "x"}),
    "an unknown key": lambda d: d.update(must_understand_me={}),
    "an attribute": lambda d: d["attributes"].update(scale="2"),
    "format 2": lambda d: d.update(zarr_format=2),
}


INVALID = (b"", b"[]", b"null", b"{", b"[" * 50_000, b'{"shape": NaN}', b" " * 100_000,
           b'{"zarr_format": 3, "zarr_format": 3}')  # fmt: skip


def _is_rejected(store: Store) -> bool:
    try:
        store.heatmap("vanilla", "activation", "real", 0)
    except RequestError as error:
        return "activation.real" in str(error)
    return False


def test_changed_and_invalid_metadata_is_rejected_with_the_array_name(store_copy):
    path = store_copy / ARRAY / "zarr.json"
    content = path.read_bytes()
    for name, change in CHANGES.items():
        _change(store_copy / ARRAY, change)
        with s2rstore.open(store_copy) as store:
            assert _is_rejected(store), name
        path.write_bytes(content)
    for invalid in INVALID:
        path.write_bytes(invalid)
        with s2rstore.open(store_copy) as store:
            assert _is_rejected(store), invalid[:20]
    assert any("activation.real" in damage.where for damage in verify(store_copy))


def test_an_array_of_format_2_is_rejected(store_copy, tmp_path):
    (store_copy / ARRAY / "zarr.json").unlink()
    document = {
        "zarr_format": 2, "shape": [40, 4, 4, 4], "chunks": [16, 4, 4, 4], "dtype": "<f4",
        "order": "C", "fill_value": 0, "compressor": None, "filters": None,
    }  # fmt: skip
    (store_copy / ARRAY / ".zarray").write_text(json.dumps(document))
    with pytest.raises(RequestError, match="format 2"):
        _read(store_copy)


def test_an_excessive_shape_is_rejected_even_if_the_index_agrees(store_copy):
    shape = [40, 4, 100_000, 100_000]

    def enlarge(document: dict[str, Any]) -> None:
        document["shape"] = shape
        document["chunk_grid"]["configuration"]["chunk_shape"] = [16, *shape[1:]]
        _sharding(document)["chunk_shape"] = [1, *shape[1:]]

    _change(store_copy / ARRAY, enlarge)
    path = ARRAY.removeprefix("runs.zarr/")
    with edit(store_copy) as draft:
        draft.update("zarr_array", {"path": path}, {"shape": json.dumps(shape)})
    with pytest.raises(RequestError, match="bytes a row"):
        _read(store_copy)


@pytest.mark.parametrize("column", ["shape", "dtype"])
def test_metadata_that_differs_from_the_index_is_rejected(store_copy, column):
    value = {"shape": "[40, 4, 2, 8]", "dtype": "float64"}[column]
    path = ARRAY.removeprefix("runs.zarr/")
    with edit(store_copy) as draft:
        draft.update("zarr_array", {"path": path}, {column: value})
    with pytest.raises(RequestError, match="which the index states"):
        _read(store_copy)


def test_frames_must_have_the_size_in_the_index(store_copy):
    with edit(store_copy) as draft:
        draft.update("dataset", {"name": "tiny"}, {"frame_width": 32})
    with (
        s2rstore.open(store_copy) as store,
        pytest.raises(RequestError, match="which the index states"),
    ):
        store.frame("sim", 0)


def _bomb(content: bytearray) -> None:
    content[4:8] = struct.pack("<I", 2**31 - 20)


def _cut_chunk(content: bytearray) -> None:
    content[12:16] = struct.pack("<I", 20)


def _far_chunk(content: bytearray) -> None:
    _reindex(content, 2**62, 100)


def _long_chunk(content: bytearray) -> None:
    _reindex(content, 0, 2**40)


def _missing_chunk(content: bytearray) -> None:
    _reindex(content, 2**64 - 1, 2**64 - 1)


def _other_checksum(content: bytearray) -> None:
    content[-1] ^= 1


def _reindex(content: bytearray, offset: int, size: int) -> None:
    import google_crc32c

    index = struct.pack("<QQ", offset, size)
    content[-20:] = index + struct.pack("<I", google_crc32c.value(index))


@pytest.mark.parametrize(
    "damage", [_bomb, _cut_chunk, _far_chunk, _long_chunk, _missing_chunk, _other_checksum],
    ids=lambda f: f.__name__,
)  # fmt: skip
def test_a_damaged_chunk_is_rejected(store_copy, damage):
    shard = store_copy / ARRAY / "c.0.0.0.0"
    content = bytearray(shard.read_bytes())
    damage(content)
    shard.write_bytes(content)
    with pytest.raises(RequestError, match=r"activation\.real.*damaged"):
        _read(store_copy)


def test_a_shard_that_is_too_large_is_rejected(store_copy):
    shard = store_copy / ARRAY / "c.0.0.0.0"
    content = shard.read_bytes()
    with shard.open("wb") as file:
        file.truncate(10 * 2**30)
        file.seek(-len(content), 2)
        file.write(content)
    with pytest.raises(RequestError, match=r"activation\.real.*bytes"):
        _read(store_copy)


@given(
    rows=st.integers(1, 40), shard=st.integers(1, 16),
    shape=st.sampled_from([(), (3,), (2, 5), (40, 40, 3)]),
    dtype=st.sampled_from(["uint8", "uint16", "float16", "float32", "float64"]),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_the_zarr_library_reads_the_written_arrays(
    tmp_path_factory, rows, shard, shape, dtype, seed
):
    path = tmp_path_factory.mktemp("array") / "a"
    plan = array_writer.plan_layout(rows, shape, dtype, shard)
    array_writer.create(path, plan, {"method": "as tested"})
    rng = np.random.default_rng(seed)
    data = (rng.integers(0, 2, (rows, *shape)) * rng.random((rows, *shape)) * 200).astype(dtype)
    for number in range(plan.shards):
        block = data[number * shard : (number + 1) * shard]
        written = array_writer.write_shard(path, number, block)
        content = (path.parent / written.path).read_bytes()
        assert (written.bytes, written.sha256) == (len(content), sha256(content).hexdigest())
    by_zarr = zarr.open_array(path, mode="r")
    by_store = stored_array.open_read(path)
    assert (by_zarr.shape, by_zarr.dtype, by_zarr.chunks, by_zarr.shards) == (
        by_store.shape, by_store.dtype, (by_store.layout.rows_per_chunk, *shape), (shard, *shape),
    )  # fmt: skip
    assert dict(by_zarr.attrs) == by_store.attrs
    rows_read = rng.integers(0, rows, 7)
    for selection in (slice(None), slice(1, -1), slice(0, rows, 2), -1, (slice(1, None), ...)):
        assert np.array_equal(by_zarr[selection], by_store[selection])
    assert np.array_equal(data[rows_read], by_store.at(rows_read))
