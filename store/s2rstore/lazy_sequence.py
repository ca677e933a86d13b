"""Sequences whose items are made when they are read, so that none of them are held."""

from __future__ import annotations

import os
import threading
import weakref
from array import array
from collections.abc import Callable, Iterable, Sequence
from tempfile import TemporaryFile
from typing import Any, TypeVar, overload

import msgspec

Item = TypeVar("Item")


class LazySequence(Sequence[Item]):
    """`count` items; `make(row)` gives one, from any thread."""

    def __init__(self, count: int, make: Callable[[int], Item]) -> None:
        self._count, self._make = count, make

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, row: int) -> Item: ...
    @overload
    def __getitem__(self, row: slice) -> list[Item]: ...
    def __getitem__(self, row: int | slice) -> Item | list[Item]:
        if isinstance(row, slice):
            return [self._make(each) for each in range(self._count)[row]]
        return self._make(range(self._count)[row])


def chosen(items: Sequence[Item], rows: Iterable[int]) -> LazySequence[Item]:
    """The items of the given rows, in their order."""
    kept = array("q", rows)
    return LazySequence(len(kept), lambda row: items[kept[row]])


class RowFile:
    """Rows of texts, bytes and numbers in a temporary file, read by number from any thread.

    A row takes 8 bytes of memory.
    """

    def __init__(self) -> None:
        self._file = TemporaryFile()  # noqa: SIM115, closed with the last reference
        weakref.finalize(self, self._file.close)
        self._ends = array("q", [0])
        self._written = 0
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._ends) - 1

    def append(self, *row: Any) -> int:
        """Add a row behind the others; gives its number."""
        content = msgspec.msgpack.encode(row)
        with self._lock:
            self._file.write(content)
            self._ends.append(self._ends[-1] + len(content))
            return len(self._ends) - 2

    def __getitem__(self, number: int) -> list[Any]:
        start, end = self._ends[number], self._ends[number + 1]
        if end > self._written:
            with self._lock:
                self._file.flush()
                self._written = self._ends[-1]
        row: list[Any] = msgspec.msgpack.decode(os.pread(self._file.fileno(), end - start, start))
        return row
