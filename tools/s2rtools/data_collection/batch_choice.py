"""Choose a batch of poses that together cover the most reducible error.

The value of a batch is the sum over all candidate poses of their reducible error times their
similarity to the nearest chosen or trained pose. This facility location function is monotone and
submodular, so that the greedy batch has at least 1 - 1/e of the value of the best one (Nemhauser,
Wolsey and Fisher, "An analysis of approximations for maximizing submodular set functions", 1978).
Gains only fall as poses are added, so that most need no second evaluation (Minoux, "Accelerated
greedy algorithms for maximizing submodular set functions", 1978).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rtools.data_collection.candidates import CandidatePoses, Codes, Floats, Poses, PoseSimilarity

_ROWS = 512
_EQUAL = 1e-12
"""Relative difference below which gains count as equal: the smaller index wins."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Chosen candidates: flat indices (n,) into (P, H), and the gain of each when it was added.

    `gains` (n,) are metres of the mean reducible error over all candidates; `total` is that mean
    where nothing is covered, `covered` what training images cover already.
    """

    cells: NDArray[np.intp]
    gains: Floats
    total: float
    covered: float


class PoseCoverage:
    """Coverage by images (P, H), 0 to 1, and weight of each candidate pose."""

    def __init__(
        self, candidates: CandidatePoses, reducible: Floats, similarity: PoseSimilarity
    ) -> None:
        """`reducible` (P, H) in metres; poses that are not usable count nothing."""
        self._candidates, self._similarity = candidates, similarity
        self.weight = np.where(candidates.usable, reducible, 0.0) / candidates.count
        self.covered = np.zeros_like(self.weight)
        self._turned = similarity.of_headings(candidates.headings, candidates.headings)
        self._near = self._neighbours()

    def _neighbours(self) -> list[tuple[NDArray[np.intp], Floats]]:
        """The places with a similarity above 0 to each place, and these similarities."""
        c, found = self._candidates, []
        for start in range(0, len(c.places), _ROWS):
            rows = slice(start, start + _ROWS)
            near = self._similarity.of_places(c.places[rows], c.rooms[rows], c.places, c.rooms)
            for row in near:
                members = np.flatnonzero(row)
                found.append((members, row[members]))
        return found

    def add_images(self, poses: Poses, rooms: Codes) -> None:
        """Cover what images at some poses (n, 3) with rooms (n,) cover."""
        c = self._candidates
        for start in range(0, len(poses), _ROWS):
            rows = slice(start, start + _ROWS)
            near = self._similarity.of_places(c.places, c.rooms, poses[rows, :2], rooms[rows])
            turned = self._similarity.of_headings(c.headings, poses[rows, 2])
            for heading, weights in enumerate(turned):
                best = (near * weights).max(axis=1)
                np.maximum(self.covered[:, heading], best, out=self.covered[:, heading])

    def gain(self, cell: int) -> float:
        """By how much an image at a candidate raises the covered weight."""
        members, similar = self._similar(cell)
        more = np.maximum(similar - self.covered[members], 0.0)
        return float((more * self.weight[members]).sum())

    def add(self, cell: int) -> None:
        """Cover what an image at a candidate covers."""
        members, similar = self._similar(cell)
        self.covered[members] = np.maximum(self.covered[members], similar)

    def _similar(self, cell: int) -> tuple[NDArray[np.intp], Floats]:
        place, heading = divmod(cell, self._candidates.headings.size)
        members, near = self._near[place]
        return members, near[:, None] * self._turned[heading]

    @property
    def covered_weight(self) -> float:
        return float((self.covered * self.weight).sum())


def choose_batch(coverage: PoseCoverage, usable: NDArray[np.intp], budget: int) -> Batch:
    """The greedy batch of at most `budget` of the candidates `usable` (n,); deterministic."""
    before = coverage.covered_weight
    scale = _EQUAL * float(coverage.weight.sum())
    queue = [(-_rounded(coverage.gain(cell), scale), cell, 0) for cell in usable.tolist()]
    heapq.heapify(queue)
    cells: list[int] = []
    gains: list[float] = []
    while queue and len(cells) < budget:
        negative, cell, size = heapq.heappop(queue)
        if size < len(cells):
            heapq.heappush(queue, (-_rounded(coverage.gain(cell), scale), cell, len(cells)))
            continue
        coverage.add(cell)
        cells.append(cell)
        gains.append(-negative)
    total = float(coverage.weight.sum())
    return Batch(np.array(cells, dtype=np.intp), np.array(gains), total, before)


def add_in_order(coverage: PoseCoverage, cells: NDArray[np.intp]) -> Batch:
    """The batch of candidates that were chosen in another way, with the gains that they have."""
    before, gains = coverage.covered_weight, []
    for cell in cells.tolist():
        gains.append(coverage.gain(cell))
        coverage.add(cell)
    return Batch(cells, np.array(gains), float(coverage.weight.sum()), before)


def _rounded(gain: float, scale: float) -> float:
    """A gain without the rounding errors of its sum, so that equal gains compare as equal."""
    return round(gain / scale) * scale if scale > 0 else gain
