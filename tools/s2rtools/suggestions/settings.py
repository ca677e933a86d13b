"""Settings of a search for changes that help, and its wall time."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from s2rstore.errors import RequestError
from s2rstore.records import Side

MOST_CHANGES = 6
_DURATION = re.compile(r"(\d+(?:\.\d+)?)(s|m|h)")
_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}


@dataclass(frozen=True, slots=True)
class SuggestSettings:
    """What is changed, and how long the search takes.

    side: the side whose images are changed: `real`, so that the model works on them, or `sim`, so
    that they look as the real ones do. budget: wall time in seconds. price: share of the initial
    cost that a change must gain to be worth its while. evaluations: most evaluations of each joint
    search by CMA-ES, each of all `frames` of the fit. judged: most instances of the judgement.
    """

    side: Side
    budget: float = 300.0
    evaluations: int = 100
    seed: int = 1
    price: float = 0.02
    changes: int = 4
    frames: int = 48
    judged: int = 240
    trust: bool = False

    def __post_init__(self) -> None:
        """Raises RequestError for values out of range."""
        if not 10 <= self.evaluations <= 100_000:
            raise RequestError(f"--evaluations {self.evaluations}: 10 .. 100000")
        if not 0 <= self.seed < 2**31:
            raise RequestError(f"--seed {self.seed}: 0 .. 2147483647")
        if not 0 <= self.price < 1:
            raise RequestError(f"--price {self.price:g}: 0 .. 0.99, a share of the initial cost")
        if not 1 <= self.changes <= MOST_CHANGES:
            raise RequestError(f"--changes {self.changes}: 1 .. {MOST_CHANGES}")
        if not 8 <= self.frames <= 4096:
            raise RequestError(f"--frames {self.frames}: 8 .. 4096")
        if not self.budget > 0:
            raise RequestError("--budget: must be above 0 seconds")


def parse_duration(text: str) -> float:
    """Seconds of a text such as `90s`, `5m` or `1h`. Raises RequestError for other texts."""
    match = _DURATION.fullmatch(text.strip())
    if match is None:
        raise RequestError(f"--budget {text}: a time such as 90s, 5m or 1h")
    return float(match[1]) * _SECONDS[match[2]]


def parse_share(text: str) -> float:
    """A share from a text such as `2%` or `0.02`. Raises RequestError for other texts."""
    number, percent = text.strip().removesuffix("%"), text.strip().endswith("%")
    try:
        return float(number) / (100 if percent else 1)
    except ValueError:
        raise RequestError(f"--price {text}: a share such as 2% or 0.02") from None


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
