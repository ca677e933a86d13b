"""The LRU cache keeps the most recently used values within its limit."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

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
