"""Arrays as keys of caches, by identity: what a plot works out of a column is worked out once."""

from __future__ import annotations

import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import partial, wraps
from threading import Lock
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

P = ParamSpec("P")
T = TypeVar("T")


class ArrayKey:
    """An array as a key: equal only to itself, not kept alive by it, never changed in place.

    There is one per array, so that keys are compared by identity alone.
    """

    __slots__ = ("_ref",)
    _ref: Callable[[], NDArray[np.generic] | None]

    def __new__(cls, array: NDArray[np.generic] | None) -> ArrayKey:
        known = _KNOWN.get(id(array))
        if known is not None and known._ref() is array:
            return known
        with _MAKING:
            known = _KNOWN.get(id(array))
            if known is None or known._ref() is not array:
                known = super().__new__(cls)
                forget = partial(_forget, id(array))
                known._ref = _nothing if array is None else weakref.ref(array, forget)
                _KNOWN[id(array)] = known
        return known

    @property
    def array(self) -> NDArray[np.generic] | None:
        """The array; None once nobody holds it."""
        return self._ref()


_KNOWN: dict[int, ArrayKey] = {}
_GONE: deque[tuple[int, object]] = deque()
_MAKING = Lock()


def _nothing() -> None:
    """Stands for None as a weak reference stands for an array."""


def _forget(number: int, gone: object) -> None:
    """When an array dies, which is at any time, in any thread: so it waits for no lock."""
    _GONE.append((number, gone))
    if _MAKING.acquire(blocking=False):
        try:
            while _GONE:
                number, gone = _GONE.popleft()
                known = _KNOWN.get(number)
                if known is not None and known._ref is gone:
                    del _KNOWN[number]
        finally:
            _MAKING.release()


def identity_key(value: object) -> object:
    """A value to compare by: arrays by identity, also inside tuples and in dataclasses' fields."""
    if isinstance(value, np.ndarray):
        return ArrayKey(value)
    if isinstance(value, tuple):
        return tuple(identity_key(part) for part in value)
    if is_dataclass(value) and type(value).__eq__ is object.__eq__:
        parts = (identity_key(getattr(value, field.name)) for field in fields(value))
        return type(value), *parts
    return value


def cached_by_identity(most: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Keep a function's last results, each for as long as all arrays among its arguments live.

    A result that holds one of these arrays keeps itself, until newer ones push it out. Arguments
    are hashable and by position, arrays as `ArrayKey`.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        results: _Results[T] = _Results(most)

        @wraps(function)
        def known(*args: P.args, **none: P.kwargs) -> T:
            found = results.get(args)
            if found is not None:
                return found[0]
            result = function(*args, **none)
            results.put(args, result)
            return result

        return known

    return decorate


class _Results(Generic[T]):
    """The last results by their arguments.

    What is dropped dies after the lock is let go, and no array that dies waits for it: either may
    run anything.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._lock = Lock()
        self._found: OrderedDict[object, tuple[T, list[weakref.ref[Any]]]] = OrderedDict()
        self._gone: deque[object] = deque()

    def get(self, args: tuple[object, ...]) -> tuple[T, list[weakref.ref[Any]]] | None:
        if self._gone:
            self._purge()
        with self._lock:
            found = self._found.get(args)
            if found is not None:
                self._found.move_to_end(args)
        return found

    def put(self, args: tuple[object, ...], result: T) -> None:
        forget = partial(self._forget, args)
        references = [weakref.ref(array, forget) for array in _arrays(args)]
        oldest = None
        with self._lock:
            before = self._found.pop(args, None)
            self._found[args] = result, references
            if len(self._found) > self._most:
                _, oldest = self._found.popitem(last=False)
        del before, oldest
        if any(reference() is None for reference in references):
            forget(None)

    def _forget(self, args: object, gone: object) -> None:
        self._gone.append(args)
        self._purge()

    def _purge(self) -> None:
        """Drop what goes with arrays that have died, unless the lock is taken: then later."""
        dropped = []
        if self._gone and self._lock.acquire(blocking=False):
            try:
                while self._gone:
                    dropped.append(self._found.pop(self._gone.popleft(), None))
            finally:
                self._lock.release()


def _arrays(args: tuple[object, ...]) -> Iterator[NDArray[np.generic]]:
    for part in args:
        if isinstance(part, tuple):
            yield from _arrays(part)
        elif isinstance(part, ArrayKey) and (array := part.array) is not None:
            yield array
