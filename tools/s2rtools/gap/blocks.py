"""Contiguous blocks of instances: what a bootstrap draws, and what is split in two halves.

Neighbours in a recording look alike, so a block is the smallest thing that counts as independent.
Blocks are fixed, as Carlstein's, so that sums over them are made once and a replicate is a row of
counts. Source: Carlstein, "The use of subseries values for estimating the variance", 1986.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """`start` (B + 1,): block b holds rows start[b] .. start[b + 1] - 1."""

    start: NDArray[np.int64]

    @property
    def count(self) -> int:
        return self.start.size - 1

    @property
    def sizes(self) -> Floats:
        """Rows of each block, (B,)."""
        return np.diff(self.start).astype(np.float64)

    def sums(self, values: Floats) -> Floats:
        """Sums over the rows of each block: (n, ...) -> (B, ...)."""
        return np.add.reduceat(values, self.start[:-1], axis=0)

    def part(self, most: int, seed: int) -> tuple[NDArray[np.int64], Blocks]:
        """Seeded whole blocks of together `most` rows or a little less: their rows, and blocks."""
        order = np.random.default_rng(seed).permutation(self.count)
        chosen = np.sort(order[np.cumsum(self.sizes[order]) <= most])
        sizes = np.diff(self.start)[chosen]
        return self.rows(chosen), Blocks(np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64))

    def rows(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """The rows of some blocks, ascending."""
        marks = np.zeros(self.count, dtype=np.bool_)
        marks[chosen] = True
        return np.flatnonzero(np.repeat(marks, np.diff(self.start)))


def cut(trajectories: NDArray[np.int32], length: int = 0) -> Blocks:
    """Blocks of nearly equal size over rows in recording order; none spans two trajectories.

    `trajectories` (n,) are codes, equal ones adjacent. `length` 0 means the rounded-up square root
    of n.
    """
    n = trajectories.size
    if n == 0:
        return Blocks(np.zeros(1, dtype=np.int64))
    length = length or int(np.ceil(np.sqrt(n)))
    edges = np.flatnonzero(np.diff(trajectories)) + 1
    starts = []
    for part in np.split(np.arange(n), edges):
        pieces = max(1, round(part.size / length))
        starts += [int(piece[0]) for piece in np.array_split(part, pieces)]
    return Blocks(np.array([*starts, n], dtype=np.int64))


def draws(count: int, replicates: int, seed: int) -> Floats:
    """How often each block enters each bootstrap sample, (R, B); every row sums to B."""
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(count, np.full(count, 1 / count), size=replicates).astype(np.float64)
    counts[(counts > 0).sum(axis=1) < 2] = 1.0  # one block alone has no pair
    return counts


def halves(
    blocks: Blocks, splits: int, seed: int
) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Seeded pairs of disjoint sets of whole blocks, as rows; both of one size, n // 2 or less."""
    rng = np.random.default_rng(seed)
    half, least = blocks.count // 2, int(blocks.start[-1])
    chosen = []
    for _ in range(splits):
        order = rng.permutation(blocks.count)
        pair = blocks.rows(order[:half]), blocks.rows(order[half : 2 * half])
        least = min(least, pair[0].size, pair[1].size)
        chosen.append(pair)
    return [(a[:least], b[:least]) for a, b in chosen]
