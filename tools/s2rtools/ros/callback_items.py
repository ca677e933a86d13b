"""Iterate over what a function passes to its callback, without keeping all of it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from queue import Queue
from typing import Any, TypeVar

Item = TypeVar("Item")
_END: Any = object()


class _StoppedError(Exception):
    """Nobody takes further items."""


def callback_items(
    run: Callable[[Callable[[Item], None]], None], waiting: int = 4
) -> Generator[Item, None, None]:
    """Call `run(put)` in a thread and yield the items that it passes to `put`.

    At most `waiting` items wait to be taken; `put` blocks until there is room. An error of `run` is
    raised after its last item. Closing the generator makes the next `put` raise, which ends `run`,
    and waits for that.
    """
    queue: Queue[Item] = Queue(waiting)
    stopped = threading.Event()

    def put(item: Item) -> None:
        if stopped.is_set():
            raise _StoppedError
        queue.put(item)

    def work() -> None:
        try:
            run(put)
        finally:
            queue.put(_END)

    with ThreadPoolExecutor(1) as pool:
        finished = pool.submit(work)
        item: Any = None
        try:
            while (item := queue.get()) is not _END:
                yield item
        finally:
            stopped.set()
            while item is not _END:
                item = queue.get()
        finished.result()
