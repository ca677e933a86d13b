"""The cache holds the most recently used values, within its limit."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore.language import evaluation
from s2rstore.lru_cache import LruCache


def test_the_last_used_stay() -> None:
    kept, made = LruCache(300), []

    def get(key: str, size: int = 100) -> np.ndarray:
        return kept.get(key, lambda: made.append(key) or np.zeros(size, np.uint8))

    for key in "abcabdab":
        get(key)
    assert made == ["a", "b", "c", "d"]
    get("c")
    assert made[-1] == "c"
    assert (kept.nbytes, len(kept)) == (300, 3)
    get("huge", 1000)
    assert (kept.nbytes, len(kept)) == (1000, 1)


def test_many_threads_share_it() -> None:
    kept = LruCache(50)

    def work(seed: int) -> bool:
        keys = np.random.default_rng(seed).integers(0, 9, 500)
        return all(
            (kept.get(int(k), lambda k=k: np.full(10, k, np.uint8)) == k).all() for k in keys
        )

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(8)))
    assert kept.nbytes <= 50


def test_a_closed_store_keeps_nothing(tiny_store: Path) -> None:
    store = s2rstore.open(tiny_store)
    error = store.run_columns("vanilla").real.error
    evaluation.select(store, "real.error > 0.1", "vanilla")
    kept = store._columns, store.evaluated, store.embeddings
    assert [recent.nbytes > 0 for recent in kept] == [True, True, False]
    store.close()
    assert [recent.nbytes for recent in kept] == [0, 0, 0]
    assert error.size
