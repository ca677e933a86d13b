"""The LRU cache keeps the most recently used values within its limit."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

import s2rstore
from s2rstore.language import evaluation
from s2rstore.lru_cache import LruCache


def test_the_most_recently_used_values_are_kept():
    cache, computed = LruCache(300), []

    def get(key: str, size: int = 100) -> np.ndarray:
        return cache.get(key, lambda: computed.append(key) or np.zeros(size, np.uint8))

    for key in "abcabdab":
        get(key)
    assert computed == ["a", "b", "c", "d"]
    get("c")
    assert computed[-1] == "c"
    assert (cache.nbytes, len(cache)) == (300, 3)
    get("huge", 1000)
    assert (cache.nbytes, len(cache)) == (1000, 1)


def test_threads_can_share_a_cache():
    cache = LruCache(50)

    def work(seed: int) -> bool:
        keys = np.random.default_rng(seed).integers(0, 9, 500)
        return all(
            (cache.get(int(k), lambda k=k: np.full(10, k, np.uint8)) == k).all() for k in keys
        )

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(8)))
    assert cache.nbytes <= 50


def test_a_closed_store_clears_its_caches(tiny_store):
    store = s2rstore.open(tiny_store)
    error = store.run_columns("vanilla").real.error
    evaluation.select(store, "real.error > 0.1", "vanilla")
    caches = store._columns, store.evaluated, store.embeddings
    assert [cache.nbytes > 0 for cache in caches] == [True, True, False]
    store.close()
    assert [cache.nbytes for cache in caches] == [0, 0, 0]
    assert error.size
