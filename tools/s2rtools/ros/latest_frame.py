"""A slot that holds the newest frame, and percentiles over a sliding window."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T")


class LatestFrame(Generic[T]):
    """Holds the newest frame: `put` replaces a frame that was not taken yet."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame: T | None = None
        self._closed = False

    def put(self, frame: T) -> bool:
        """Store a frame; returns whether it replaced another."""
        with self._changed:
            replaced, self._frame = self._frame is not None, frame
            self._changed.notify()
        return replaced

    def take(self, timeout: float) -> T | None:
        """Take the frame; waits up to `timeout` seconds, then returns None."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._frame is not None, timeout)
            frame, self._frame = self._frame, None
        return frame

    def close(self) -> None:
        """End the waiting of `take`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class SlidingWindow:
    """The last `size` values, with percentiles."""

    def __init__(self, size: int = 900) -> None:
        self._lock = threading.Lock()
        self._values: deque[float] = deque(maxlen=size)

    def add(self, value: float) -> None:
        with self._lock:
            self._values.append(value)

    def percentiles(self, *percents: float) -> list[float]:
        """Percentiles of the window, NaN while it is empty."""
        with self._lock:
            values = np.array(self._values)
        if not len(values):
            return [float("nan")] * len(percents)
        return [float(value) for value in np.percentile(values, percents)]
