"""A missing shard is an error that names it, for every reader; nobody takes it for zeros."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.arrays.stored_array import METADATA
from s2rstore.errors import RequestError
from s2rstore.files import layout, safe_files
from s2rstore.language import evaluation
from s2rstore.metrics.nearest_neighbours import embedding
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.precompute.tasks.umap_projection import principal_components
from tests.support import embeddings

N, WIDTH = 40, 8
Read = Callable[[], object]


@pytest.fixture
def path(store_copy: Path) -> Path:
    """A store with embeddings of both sides of a run, in shards of 16 rows."""
    rng = np.random.default_rng(0)
    sides = {side: rng.normal(size=(N, WIDTH)) for side in ("sim", "real")}
    embeddings.add(store_copy, "vanilla", sides, "embedding", ("feature",), 16)
    return store_copy


def stored_arrays(store: Store) -> Iterator[Read]:
    for run in store.runs:
        for record in store.array_parts(run):
            yield lambda record=record: store.stored(record)[:]


def joined_arrays(store: Store) -> Iterator[Read]:
    """The arrays that `Store.array` joins from their parts."""
    for run in store.runs:
        for record in store.array_kinds(run):
            if record.axes[0] == "iid":
                names = run, record.kind, record.side, record.mode
                yield lambda names=names: store.array(*names)[1][:]


def frames(store: Store) -> Iterator[Read]:
    for domain in SIDES:
        for iid in (0, 24, 25, 39):  # the ends of either trajectory
            yield lambda domain=domain, iid=iid: store.frame(domain, iid)


def parts_of_embeddings(store: Store) -> Iterator[Read]:
    sim, real = (store.array("vanilla", "embedding", side)[1] for side in SIDES)
    yield lambda: sim[17:18]
    yield lambda: sim[20]
    yield lambda: np.asarray(sim)
    yield lambda: sim.at(np.array([3, 17]))
    yield lambda: embedding(store, "vanilla", "sim")
    yield lambda: evaluation.select(store, "like(1, 5)")
    yield lambda: principal_components((sim, real), np.ones(N, bool))


def shards_read(path: Path, read: Read) -> set[str]:
    """The shards of a store, relative to it, that a function opens."""
    names, open_read = set(), safe_files.open_read

    def recorded(root: Path, relative: str | Path) -> object:
        file = (root / relative).resolve().relative_to(path.resolve()).as_posix()
        if file.startswith((layout.FRAMES, layout.RUNS)) and not file.endswith(METADATA):
            names.add(file)
        return open_read(root, relative)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(safe_files, "open_read", recorded)
        read()
    return names


@contextmanager
def hidden(path: Path) -> Iterator[None]:
    """Rename a file away, and back afterwards."""
    moved = path.rename(path.with_name("hidden"))
    yield
    moved.rename(path)


@pytest.mark.parametrize(
    "readers", [stored_arrays, joined_arrays, frames, parts_of_embeddings], ids=lambda f: f.__name__
)
def test_every_reader_names_each_missing_shard(path, readers):
    with s2rstore.open(path) as store:
        for read in readers(store):
            store.embedding_cache.clear()
            store.selection_cache.clear()
            shards = shards_read(path, read)
            assert shards
            for shard in shards:
                store.embedding_cache.clear()
                store.selection_cache.clear()
                message = f"{re.escape(str(path / shard))}.*missing"
                with hidden(path / shard), pytest.raises(RequestError, match=message):
                    read()
