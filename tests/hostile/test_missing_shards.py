"""A missing shard is an error that names the array, for every reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.metrics.nearest_neighbours import embedding
from s2rtools.precompute.tasks.umap_projection import principal_components

N, WIDTH = 40, 8


@pytest.fixture
def store_with_embeddings(store_copy: Path) -> Path:
    """A store with embeddings of both sides of a run, in shards of 16 rows."""
    rng = np.random.default_rng(0)
    with edit(store_copy) as draft:
        for side in ("sim", "real"):
            relative = f"vanilla/key0/embedding.{side}"
            path = store_copy / "runs.zarr" / relative
            array_writer.create(path, array_writer.plan_layout(N, (WIDTH,), "float32", 16))
            rows = rng.normal(size=(N, WIDTH)).astype(np.float32)
            for shard in range(3):
                block = rows[16 * shard : 16 * shard + 16]
                file = array_writer.write_shard(path, shard, block)
                name = file.path
                Ledger(store_copy).add(f"{relative}:{shard}", [(name, len(block))])
            draft.insert_row(
                "zarr_array",
                {"run": "vanilla", "kind": "embedding", "side": side, "path": relative,
                 "dtype": "float32", "shape": [N, WIDTH], "axes": ["iid", "feature"],
                 "scale": 1.0, "zero": 0.0, "unit": ""},
            )  # fmt: skip
    return store_copy


@pytest.mark.parametrize("missing", ["c.1.0", "c.*"])
def test_every_reader_names_the_missing_shard(store_with_embeddings: Path, missing: str) -> None:
    for side in ("sim", "real"):
        folder = store_with_embeddings / f"runs.zarr/vanilla/key0/embedding.{side}"
        for path in folder.glob(missing):
            path.unlink()
    with s2rstore.open(store_with_embeddings) as store:
        _, sim = store.array("vanilla", "embedding", "sim")
        _, real = store.array("vanilla", "embedding", "real")
        readers = (
            lambda: sim[:],
            lambda: sim[17:18],
            lambda: sim[20],
            lambda: np.asarray(sim),
            lambda: sim.at(np.array([3, 17])),
            lambda: embedding(store, "vanilla", "sim"),
            lambda: evaluation.select(store, "like(1, 5)"),
            lambda: principal_components((sim, real), np.ones(N, bool)),
        )
        for read in readers:
            with pytest.raises(RequestError, match=r"embedding.*missing"):
                read()
