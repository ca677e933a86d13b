"""A bounded cache for any thread, which drops the least recently used values."""

from __future__ import annotations

import operator
from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Event, Lock
from typing import Any, TypeVar

V = TypeVar("V")


class LruCache:
    """The most recently used values, up to `limit` bytes in total, but at least one.

    `size` measures a value in bytes; by default its `nbytes`, as numpy arrays have it.
    """

    def __init__(
        self, limit: int, size: Callable[[Any], int] = operator.attrgetter("nbytes")
    ) -> None:
        self._limit = limit
        self._size = size
        self._values: OrderedDict[Hashable, Any] = OrderedDict()
        self._total = 0
        self._lock = Lock()
        self._computing: dict[Hashable, Event] = {}

    def get(self, key: Hashable, compute: Callable[[], V]) -> V:
        """The cached value of `key`, or else the computed one, which is cached.

        A key identifies one value of one type, which callers must not change. The value is computed
        once: other threads wait for it, and compute it themselves where that failed.
        """
        while True:
            with self._lock:
                if key in self._values:
                    self._values.move_to_end(key)
                    cached: V = self._values[key]
                    return cached
                computing = self._computing.get(key)
                if computing is None:
                    self._computing[key] = Event()
                    break
            computing.wait()
        try:
            value = compute()
            with self._lock:
                self._values[key] = value
                self._total += self._size(value)
                while self._total > self._limit and len(self._values) > 1:
                    self._total -= self._size(self._values.popitem(last=False)[1])
            return value
        finally:
            with self._lock:
                self._computing.pop(key).set()

    def __contains__(self, key: Hashable) -> bool:
        with self._lock:
            return key in self._values

    def drop(self, condition: Callable[[Hashable], bool]) -> None:
        """Drop the values whose keys meet a condition."""
        with self._lock:
            for key in [key for key in self._values if condition(key)]:
                self._total -= self._size(self._values.pop(key))

    def clear(self) -> None:
        """Drop all values."""
        self.drop(lambda key: True)

    @property
    def nbytes(self) -> int:
        """Total bytes of the cached values."""
        return self._total

    def __len__(self) -> int:
        return len(self._values)
