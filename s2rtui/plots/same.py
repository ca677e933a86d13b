"""Arrays as keys of caches, by identity: what a plot works out of a column is worked out once."""

from __future__ import annotations

import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import partial, wraps
from threading import RLock
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

P = ParamSpec("P")
T = TypeVar("T")


class Same:
    """An array as a key: equal only to itself, not kept alive by it, never changed in place.

    There is one per array, so that keys are compared by identity alone.
    """

    __slots__ = ("_ref",)
    _ref: Callable[[], NDArray[np.generic] | None]

    def __new__(cls, array: NDArray[np.generic] | None) -> Same:
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


_KNOWN: dict[int, Same] = {}
_MAKING = RLock()


def _nothing() -> None:
    """Stands for None as a weak reference stands for an array."""


def _forget(number: int, gone: object) -> None:
    with _MAKING:
        known = _KNOWN.get(number)
        if known is not None and known._ref is gone:
            del _KNOWN[number]


def identity(value: object) -> object:
    """A value to compare by: arrays by identity, also inside tuples and in dataclasses' fields."""
    if isinstance(value, np.ndarray):
        return Same(value)
    if isinstance(value, tuple):
        return tuple(identity(part) for part in value)
    if is_dataclass(value) and type(value).__eq__ is object.__eq__:
        parts = (identity(getattr(value, field.name)) for field in fields(value))
        return type(value), *parts
    return value


def kept(most: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Keep a function's last results, each for as long as all arrays among its arguments live.

    Arguments are hashable and by position, arrays as `Same`.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        results: OrderedDict[object, tuple[T, list[weakref.ref[Any]]]] = OrderedDict()
        lock = RLock()

        @wraps(function)
        def known(*args: P.args, **none: P.kwargs) -> T:
            with lock:
                found = results.get(args)
                if found is not None:
                    results.move_to_end(args)
                    return found[0]
            result = function(*args, **none)

            def forget(_: object) -> None:
                with lock:
                    results.pop(args, None)

            with lock:
                results[args] = result, [weakref.ref(array, forget) for array in _arrays(args)]
                if len(results) > most:
                    results.popitem(last=False)
            return result

        return known

    return decorate


def _arrays(args: tuple[object, ...]) -> Iterator[NDArray[np.generic]]:
    for part in args:
        if isinstance(part, tuple):
            yield from _arrays(part)
        elif isinstance(part, Same) and (array := part.array) is not None:
            yield array
