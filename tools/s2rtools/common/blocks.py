"""Contiguous blocks of instances: images of one block look alike, those of different blocks less.

Source: Carlstein, "The use of subseries values for estimating the variance", Annals of Statistics
14, 1986.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MIN_TRAJECTORIES = 6
"""Fewest trajectories that are kept whole."""
MAX_TRAJECTORY_SHARE = 1 / 3
"""A trajectory with more than this share of the rows leaves too few others."""


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Contiguous blocks of rows: block b holds rows start[b] .. start[b + 1] - 1.

    `start` is (B + 1,), `trajectory` (B,) the code of each block's trajectory. A unit is kept
    whole: a trajectory where there are at least `MIN_TRAJECTORIES` of similar length, else a
    block.
    """

    start: NDArray[np.int64]
    trajectory: NDArray[np.int64]

    @property
    def count(self) -> int:
        return self.start.size - 1

    @property
    def sizes(self) -> Floats:
        """Rows of each block, (B,)."""
        return np.diff(self.start).astype(np.float64)

    @property
    def by_trajectory(self) -> bool:
        """Whether whole trajectories are the units."""
        _, codes = np.unique(self.trajectory, return_inverse=True)
        rows = np.bincount(codes, self.sizes)
        return bool(
            rows.size >= MIN_TRAJECTORIES and rows.max() <= MAX_TRAJECTORY_SHARE * rows.sum()
        )

    @property
    def units(self) -> NDArray[np.int64]:
        """Code 0, 1, ... of each block's unit, (B,)."""
        if not self.by_trajectory:
            return np.arange(self.count)
        return np.unique(self.trajectory, return_inverse=True)[1]

    @property
    def unit_count(self) -> int:
        return int(np.unique(self.units).size)

    def sums(self, values: Floats) -> Floats:
        """Sums over the rows of each block: (n, ...) -> (B, ...)."""
        return np.add.reduceat(values, self.start[:-1], axis=0)

    def rows(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """The rows of some blocks, ascending."""
        marks = np.zeros(self.count, dtype=np.bool_)
        marks[chosen] = True
        return np.flatnonzero(np.repeat(marks, np.diff(self.start)))


def evenly_spread(count: int, most: int) -> NDArray[np.intp]:
    """At most `most` of the rows 0 .. count - 1, evenly spread, the first and the last included."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


def split_into_blocks(trajectories: NDArray[np.integer], length: int = 0) -> Blocks:
    """Blocks of nearly equal size over rows in recording order; none spans two trajectories.

    `trajectories` (n,) are codes, equal ones adjacent. `length` 0 is the rounded-up square root of
    n.
    """
    n = trajectories.size
    if n == 0:
        return Blocks(np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64))
    length = length or int(np.ceil(np.sqrt(n)))
    edges = [0, *(np.flatnonzero(np.diff(trajectories)) + 1).tolist(), n]
    parts = []
    for first, end in pairwise(edges):
        pieces = max(1, round((end - first) / length))
        size, longer = divmod(end - first, pieces)  # the first `longer` blocks have a row more
        numbers = np.arange(pieces)
        parts.append(first + numbers * size + np.minimum(numbers, longer))
    starts = np.concatenate(parts)
    codes = np.asarray(trajectories[starts], dtype=np.int64)
    return Blocks(np.array([*starts, n], dtype=np.int64), codes)
