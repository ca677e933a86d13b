"""A missing shard is an error that names the array, for every reader."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import evaluation
from s2rstore.metrics.nearest_neighbours import embedding
from s2rtools.precompute.tasks.umap_projection import principal_components
from tests.support import embeddings

N, WIDTH = 40, 8


@pytest.fixture
def store_with_embeddings(store_copy: Path) -> Path:
    """A store with embeddings of both sides of a run, in shards of 16 rows."""
    rng = np.random.default_rng(0)
    sides = {side: rng.normal(size=(N, WIDTH)) for side in ("sim", "real")}
    embeddings.add(store_copy, "vanilla", sides, "embedding", ("feature",), 16)
    return store_copy


@pytest.mark.parametrize("missing", ["c.1.0", "c.*"])
def test_every_reader_names_the_missing_shard(store_with_embeddings, missing):
    for side in ("sim", "real"):
        folder = store_with_embeddings / f"runs.zarr/vanilla/made/embedding.{side}"
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
