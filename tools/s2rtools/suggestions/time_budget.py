"""The wall time of a search: how long its steps took, and whether another one fits."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class TimeBudget:
    """`seconds` of wall time from now on; `clock` returns seconds.

    Steps of a kind are measured, so that none begins that would end too late.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._end = clock() + seconds
        self._taken: dict[str, list[float]] = {}

    @contextmanager
    def step(self, kind: str) -> Iterator[None]:
        """Measure what the body takes."""
        began = self._clock()
        yield
        self._taken.setdefault(kind, []).append(self._clock() - began)

    def seconds(self, kind: str) -> float:
        """The longest step of a kind; 0 where none was measured.

        The first of several is left out, because it also reads images and compiles.
        """
        taken = self._taken.get(kind, [0.0])
        return max(taken[1:] or taken)

    def fits(self, kind: str, reserve: float = 0.0) -> bool:
        """Whether a step of a kind would end `reserve` seconds before the end of the budget."""
        return self._clock() + self.seconds(kind) + reserve <= self._end
