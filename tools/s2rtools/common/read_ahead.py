"""Compute items in an executor ahead of their consumer."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_ahead(
    pool: Executor, work: Callable[[Item], Result], items: Iterable[Item], window: int = 64
) -> Iterator[Result]:
    """Results in the order of the items; at most `window` are computed in advance."""
    rest = iter(items)
    waiting: deque[Future[Result]] = deque(pool.submit(work, i) for i in islice(rest, window))
    while waiting:
        result = waiting.popleft().result()
        waiting.extend(pool.submit(work, item) for item in islice(rest, 1))
        yield result
