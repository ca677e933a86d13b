"""Caches keyed by the identity of arrays: results derived from a column are computed once."""

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
    """A hashable stand-in for an array, equal only for the same array object.

    It holds a weak reference. There is one key per array, so keys compare by identity. Arrays must
    not be changed in place.
    """

    __slots__ = ("_ref",)
    _ref: Callable[[], NDArray[np.generic] | None]

    def __new__(cls, array: NDArray[np.generic] | None) -> ArrayKey:
        key = _KEYS.get(id(array))
        if key is not None and key._ref() is array:
            return key
        with _KEY_LOCK:
            key = _KEYS.get(id(array))
            if key is None or key._ref() is not array:
                key = super().__new__(cls)
                forget = partial(_forget, id(array))
                key._ref = _no_array if array is None else weakref.ref(array, forget)
                _KEYS[id(array)] = key
        return key

    @property
    def array(self) -> NDArray[np.generic] | None:
        """The array, or None after it was deleted."""
        return self._ref()


_KEYS: dict[int, ArrayKey] = {}
_DELETED: deque[tuple[int, object]] = deque()
_KEY_LOCK = Lock()


def _no_array() -> None:
    """The weak reference of None."""


def _forget(number: int, deleted_ref: object) -> None:
    """Drop the key of a deleted array.

    Runs whenever an array is deleted, in any thread, so it must not wait for a lock.
    """
    if _DELETED is None:  # the interpreter is closing
        return
    _DELETED.append((number, deleted_ref))
    if _KEY_LOCK.acquire(blocking=False):
        try:
            while _DELETED:
                number, deleted_ref = _DELETED.popleft()
                key = _KEYS.get(number)
                if key is not None and key._ref is deleted_ref:
                    del _KEYS[number]
        finally:
            _KEY_LOCK.release()


def identity_key(value: object) -> object:
    """A key of a value; arrays in tuples, dictionaries and dataclasses count by identity."""
    if isinstance(value, np.ndarray):
        return ArrayKey(value)
    if isinstance(value, tuple):
        return tuple([identity_key(part) for part in value])
    if isinstance(value, dict):
        return tuple([(name, identity_key(part)) for name, part in value.items()])
    if is_dataclass(value) and type(value).__eq__ is object.__eq__:
        parts = [identity_key(getattr(value, field.name)) for field in fields(value)]
        return type(value), *parts
    return value


def cached_by_identity(limit: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Cache the last `limit` results of a function while all arrays in its arguments live.

    Arguments are positional, with keys as of `identity_key`. A result that refers to
    an array of its arguments stays until newer results push it out.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        results: _Results[T] = _Results(limit)

        @wraps(function)
        def wrapper(*args: P.args, **none: P.kwargs) -> T:
            key = tuple([identity_key(argument) for argument in args])
            entry = results.get(key)
            if entry is not None:
                return entry[0]
            result = function(*args, **none)
            results.put(key, result)
            return result

        return wrapper

    return decorate


class _Results(Generic[T]):
    """The most recent results by arguments.

    Results are released outside the lock, and deletions of arrays never wait for it, since both
    may run arbitrary code.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._lock = Lock()
        self._entries: OrderedDict[object, tuple[T, list[weakref.ref[Any]]]] = OrderedDict()
        self._deleted: deque[object] = deque()

    def get(self, args: tuple[object, ...]) -> tuple[T, list[weakref.ref[Any]]] | None:
        if self._deleted:
            self._purge()
        with self._lock:
            entry = self._entries.get(args)
            if entry is not None:
                self._entries.move_to_end(args)
        return entry

    def put(self, args: tuple[object, ...], result: T) -> None:
        forget = partial(self._forget, args)
        references = [weakref.ref(array, forget) for array in _arrays(args)]
        oldest = None
        with self._lock:
            before = self._entries.pop(args, None)
            self._entries[args] = result, references
            if len(self._entries) > self._limit:
                _, oldest = self._entries.popitem(last=False)
        del before, oldest
        if any(reference() is None for reference in references):
            forget(None)

    def _forget(self, args: object, deleted_ref: object) -> None:
        self._deleted.append(args)
        self._purge()

    def _purge(self) -> None:
        """Drop the results of deleted arrays; postponed where the lock is taken."""
        dropped = []
        if self._deleted and self._lock.acquire(blocking=False):
            try:
                while self._deleted:
                    dropped.append(self._entries.pop(self._deleted.popleft(), None))
            finally:
                self._lock.release()


def _arrays(args: tuple[object, ...]) -> Iterator[NDArray[np.generic]]:
    for part in args:
        if isinstance(part, tuple):
            yield from _arrays(part)
        elif isinstance(part, ArrayKey) and (array := part.array) is not None:
            yield array
