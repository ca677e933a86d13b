"""Find similar instances: nearest neighbours in the embeddings of one side of a run.

By brute force: exact, and fast enough for one query at a time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError
from s2rstore.index.population import NEW_INSTANCES, Population
from s2rstore.metrics.top_k import top_k
from s2rstore.reader import Store
from s2rstore.records import Side

_BLOCK = 4096
_KINDS = ("pca", "embedding")


def neighbours(
    store: Store,
    run: str,
    side: Side,
    iid: int,
    count: int,
    population: Population = NEW_INSTANCES,
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """An instance and its nearest in one side's embeddings, with their distances.

    The instance comes first, at 0; then at most `count` of the population, the nearest first, ties
    by iid. Empty where the instance has no embedding.
    Raises RequestError for an unknown instance, NotComputedError for a run without embeddings.
    """
    store.check_instance(iid)
    base = population.mask(store.instances, store.run_columns(run))
    return nearest(embedding(store, run, side), iid, count, base)


def can_compare(store: Store, run: str) -> bool:
    """Whether a run has embeddings."""
    return any(record.kind in _KINDS for record in store.array_kinds(run))


def embedding(store: Store, run: str, side: Side) -> NDArray[np.float32]:
    """The vectors that `neighbours` compares, (N, D): principal components, NaN where missing.

    Cached for the next query. Raises NotComputedError for a run without embeddings.
    """

    def read() -> NDArray[np.float32]:
        kinds = {record.kind for record in store.array_kinds(run)}
        kind = next((kind for kind in _KINDS if kind in kinds), None)
        if kind is None:
            command = store.run(run).embedding_command
            message = f"run {run!r} has no embeddings to compare; {command} makes them"
            raise NotComputedError(message)
        return np.asarray(store.array(run, kind, side)[1].filled(), dtype=np.float32)

    return store.embedding_cache.get((run, side), read)


def nearest(
    points: NDArray[np.float32], row: int, count: int, base: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """`row` itself, then its at most `count` nearest among `base` (n,), and the distances.

    `points` (n, d); Euclidean distance, ties by index. Points that are not finite are near
    nothing, and nothing is near them.
    """
    distances = _distances(points, points[row])
    if not np.isfinite(distances[row]):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.float32)
    others = base & np.isfinite(distances)
    others[row] = False
    rows = np.flatnonzero(top_k(distances, others, count, largest=False))
    rows = rows[np.argsort(distances[rows], kind="stable")]
    chosen = np.concatenate([[row], rows]).astype(np.int64)
    return chosen, np.sqrt(distances[chosen])


def _distances(points: NDArray[np.float32], centre: NDArray[np.float32]) -> NDArray[np.float32]:
    """Squared distances, summed over differences so that near ones stay exact; shape (n,)."""
    distances = np.empty(len(points), dtype=np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        for start in range(0, len(points), _BLOCK):
            block = points[start : start + _BLOCK] - centre
            np.einsum("ij,ij->i", block, block, out=distances[start : start + _BLOCK])
    return distances
