"""Find out from the stamps of frames whether the clocks of camera and proxy agree."""

from __future__ import annotations

from collections import deque

import numpy as np

FUTURE = 0.05
"""Seconds by which a stamp may lie in the future; clocks synchronised by NTP differ by less."""
_FRAMES = 30
"""Frames after which a problem is reported."""


class ClockCheck:
    """Collects the ages of frames; `problem` is one line, empty where the stamps make sense."""

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
