"""Working ahead of a consumer in threads, by a bounded number of items."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_WINDOW = 64


def ahead(
    pool: Executor, work: Callable[[Item], Result], items: Iterable[Item], window: int = _WINDOW
) -> Iterator[Result]:
    """Results in order, with at most `window` of them waiting: memory stays small."""
    rest = iter(items)
    waiting: deque[Future[Result]] = deque(pool.submit(work, i) for i in islice(rest, window))
    while waiting:
        result = waiting.popleft().result()
        waiting.extend(pool.submit(work, item) for item in islice(rest, 1))
        yield result
