"""The newest frame, percentiles over a sliding window, and a check of the stamps of frames."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T")
FUTURE = 0.05
"""Seconds by which a stamp may lie in the future; clocks synchronised by NTP differ by less."""
_FRAMES = 30
"""Frames after which a problem is reported."""


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


class ClockCheck:
    """Collects the ages of frames: do the clocks of camera and proxy agree?

    `problem` is one line, empty where the stamps make sense.
    """

    def __init__(self) -> None:
        self._ages: deque[float] = deque(maxlen=_FRAMES)
        self._unstamped = 0
        self._max_age: float | None = None

    def add(self, stamp: float, age: float, max_age: float | None) -> None:
        """Add a frame by its stamp and age in seconds; a stamp of 0 means none."""
        self._max_age = max_age
        if stamp > 0:
            self._unstamped = 0
            self._ages.append(age)
        else:
            self._unstamped += 1

    @property
    def problem(self) -> str:
        if self._unstamped >= _FRAMES and self._max_age is not None:
            return "frames have no header stamp; max_age has no effect on them"
        if len(self._ages) < _FRAMES:
            return ""
        middle = float(np.median(self._ages))
        if middle < -FUTURE:
            return (
                f"frames are stamped {-middle:.3g} s in the future; "
                "synchronise the clocks of camera and proxy"
            )
        if self._max_age is not None and min(self._ages) > self._max_age:
            return (
                f"the last {_FRAMES} frames were older than max_age ({middle:.3g} s); "
                "synchronise the clocks of camera and proxy, or raise max_age"
            )
        return ""
