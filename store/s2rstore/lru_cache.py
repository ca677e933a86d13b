"""A bounded store of values that are dear to make."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Event, Lock
from typing import Protocol, TypeVar


class Sized(Protocol):
    """Knows its size in bytes, as numpy arrays do."""

    @property
    def nbytes(self) -> int: ...


V = TypeVar("V", bound=Sized)


class LruCache:
    """The values asked for last, up to `limit` bytes together, at least one; for any thread."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._values: OrderedDict[Hashable, Sized] = OrderedDict()
        self._bytes = 0
        self._lock = Lock()
        self._making: dict[Hashable, Event] = {}

    def get(self, key: Hashable, make: Callable[[], V]) -> V:
        """The value of `key`, made where it is not kept.

        A key stands for one value of one type, which nobody may change. It is made once: other
        threads wait for it, and make it themselves where that failed.
        """
        while True:
            with self._lock:
                if key in self._values:
                    self._values.move_to_end(key)
                    return self._values[key]  # type: ignore[return-value]
                making = self._making.get(key)
                if making is None:
                    self._making[key] = Event()
                    break
            making.wait()
        try:
            value = make()
            with self._lock:
                self._put(key, value)
            return value
        finally:
            with self._lock:
                self._making.pop(key).set()

    def __contains__(self, key: Hashable) -> bool:
        with self._lock:
            return key in self._values

    def drop(self, unwanted: Callable[[Hashable], bool]) -> None:
        """Keep nothing whose key is unwanted."""
        with self._lock:
            for key in [key for key in self._values if unwanted(key)]:
                self._bytes -= self._values.pop(key).nbytes

    def clear(self) -> None:
        """Keep nothing."""
        self.drop(lambda key: True)

    def _put(self, key: Hashable, value: Sized) -> None:
        self._values[key] = value
        self._bytes += value.nbytes
        while self._bytes > self._limit and len(self._values) > 1:
            _, oldest = self._values.popitem(last=False)
            self._bytes -= oldest.nbytes

    @property
    def nbytes(self) -> int:
        """What is kept, together."""
        return self._bytes

    def __len__(self) -> int:
        return len(self._values)
