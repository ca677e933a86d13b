"""What is worked out of an array is kept as long as the array, and no longer."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from s2rtui.analysis import identity_cache as same
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity


def test_the_same_array_is_worked_out_once() -> None:
    asked = []

    @cached_by_identity(4)
    def doubled(values: ArrayKey, factor: int) -> np.ndarray:
        asked.append(factor)
        return np.asarray(values.array) * factor

    first, equal = np.arange(3), np.arange(3)
    assert doubled(ArrayKey(first), 2) is doubled(ArrayKey(first), 2)
    assert doubled(ArrayKey(equal), 2) is not doubled(ArrayKey(first), 2)
    doubled(ArrayKey(first), 3)
    assert asked == [2, 2, 3]


def test_a_result_goes_with_any_of_its_arrays() -> None:
    @cached_by_identity(4)
    def total(pair: tuple[ArrayKey, ArrayKey], more: ArrayKey) -> np.ndarray:
        return sum(np.asarray(same.array) for same in (*pair, more))

    arrays = [np.ones(3) for _ in range(3)]
    for gone in range(3):
        result = weakref.ref(total((ArrayKey(arrays[0]), ArrayKey(arrays[1])), ArrayKey(arrays[2])))
        assert result() is not None
        arrays[gone] = np.ones(3)
        gc.collect()
        assert result() is None


def test_only_the_last_are_kept() -> None:
    @cached_by_identity(2)
    def copy_store(values: ArrayKey) -> np.ndarray:
        return np.array(values.array)

    arrays = [np.arange(n) for n in range(4)]
    results = [weakref.ref(copy_store(ArrayKey(array))) for array in arrays]
    assert [result() is None for result in results] == [True, True, False, False]


def test_a_new_array_in_an_old_place_is_another() -> None:
    array = np.arange(5)
    key = ArrayKey(array)
    del array
    gc.collect()
    others = [np.arange(5) for _ in range(50)]
    assert key.array is None
    assert all(key != ArrayKey(other) for other in others)
    assert key == key
    assert ArrayKey(None) == ArrayKey(None)
    assert ArrayKey(None) != ArrayKey(others[0])


def test_many_threads_ask_while_arrays_go() -> None:
    @cached_by_identity(3)
    def negative(values: ArrayKey) -> np.ndarray:
        return -np.asarray(values.array)

    def work(seed: int) -> bool:
        return all((negative(ArrayKey(a)) == -a).all() for a in (np.full(9, i) for i in range(300)))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(8)))


class Last:
    """A result that does something when it goes."""

    def __init__(self, last: Callable[[], object]) -> None:
        self._last = last

    def __del__(self) -> None:
        self._last()


def test_a_result_goes_after_its_lock() -> None:
    """As it goes, another thread can ask the same function."""
    asked: list[bool] = []

    @cached_by_identity(1)
    def made(values: ArrayKey, number: int) -> Last:
        return Last(elsewhere)

    def elsewhere() -> None:
        thread = threading.Thread(target=made, args=(ArrayKey(other), 1), daemon=True)
        thread.start()
        thread.join(5)
        asked.append(not thread.is_alive())

    array, other = np.ones(3), np.zeros(3)
    made(ArrayKey(other), 1)
    made(ArrayKey(array), 2)
    del array
    assert asked
    assert all(asked)


def test_an_array_that_dies_waits_for_no_lock() -> None:
    """It may die in a thread that must not wait: the lock's owner may wait for that one."""
    arrays = [np.ones(3)]
    ArrayKey(arrays[0])
    with same._KEY_LOCK:
        dying = threading.Thread(target=arrays.clear, daemon=True)
        dying.start()
        dying.join(5)
        assert not dying.is_alive()
    ArrayKey(np.ones(3))
    assert not same._DELETED
