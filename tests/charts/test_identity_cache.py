"""The identity cache keeps results as long as their arrays exist."""

import gc
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from s2rtui.analysis import identity_cache as same
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity


def test_a_result_is_computed_once_per_array():
    calls = []

    @cached_by_identity(4)
    def doubled(values: ArrayKey, factor: int) -> np.ndarray:
        calls.append(factor)
        return np.asarray(values.array) * factor

    first, equal = np.arange(3), np.arange(3)
    assert doubled(ArrayKey(first), 2) is doubled(ArrayKey(first), 2)
    assert doubled(ArrayKey(equal), 2) is not doubled(ArrayKey(first), 2)
    doubled(ArrayKey(first), 3)
    assert calls == [2, 2, 3]


def test_a_result_is_dropped_with_any_of_its_arrays():
    @cached_by_identity(4)
    def total(pair: tuple[ArrayKey, ArrayKey], more: ArrayKey) -> np.ndarray:
        return sum(np.asarray(same.array) for same in (*pair, more))

    arrays = [np.ones(3) for _ in range(3)]
    for index in range(3):
        result = weakref.ref(total((ArrayKey(arrays[0]), ArrayKey(arrays[1])), ArrayKey(arrays[2])))
        assert result() is not None
        arrays[index] = np.ones(3)
        gc.collect()
        assert result() is None


def test_the_cache_size_is_limited():
    @cached_by_identity(2)
    def copy_array(values: ArrayKey) -> np.ndarray:
        return np.array(values.array)

    arrays = [np.arange(n) for n in range(4)]
    results = [weakref.ref(copy_array(ArrayKey(array))) for array in arrays]
    assert [result() is None for result in results] == [True, True, False, False]


def test_a_new_array_at_a_reused_address_has_another_key():
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


def test_threads_can_use_the_cache_while_arrays_are_deleted():
    @cached_by_identity(3)
    def negative(values: ArrayKey) -> np.ndarray:
        return -np.asarray(values.array)

    def work(seed: int) -> bool:
        return all((negative(ArrayKey(a)) == -a).all() for a in (np.full(9, i) for i in range(300)))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(8)))


class CallbackOnDelete:
    """A result that calls a function when it is deleted."""

    def __init__(self, last: Callable[[], object]) -> None:
        self._last = last

    def __del__(self) -> None:
        self._last()


def test_a_result_is_deleted_outside_the_lock():
    """While it is deleted, another thread can call the cached function."""
    completed: list[bool] = []

    @cached_by_identity(1)
    def compute(values: ArrayKey, number: int) -> CallbackOnDelete:
        return CallbackOnDelete(call_in_other_thread)

    def call_in_other_thread() -> None:
        thread = threading.Thread(target=compute, args=(ArrayKey(other), 1), daemon=True)
        thread.start()
        thread.join(5)
        completed.append(not thread.is_alive())

    array, other = np.ones(3), np.zeros(3)
    compute(ArrayKey(other), 1)
    compute(ArrayKey(array), 2)
    del array
    assert completed
    assert all(completed)


def test_deleting_an_array_does_not_wait_for_the_lock():
    """The array may be deleted in a thread for which the owner of the lock waits."""
    arrays = [np.ones(3)]
    ArrayKey(arrays[0])
    with same._KEY_LOCK:
        deleter = threading.Thread(target=arrays.clear, daemon=True)
        deleter.start()
        deleter.join(5)
        assert not deleter.is_alive()
    ArrayKey(np.ones(3))
    assert not same._DELETED
