"""The instances of the fit and those of the judgement: alternating blocks of each trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rstore.metrics.bootstrap import split_into_blocks
from s2rstore.metrics.run_metrics import population
from s2rstore.reader import Store

MIN_INSTANCES = 16
"""Fewest new instances of a search."""
_FEWEST_BLOCKS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Instances in recording order: `iids` (n,), and the code (n,) of the block of each."""

    iids: NDArray[np.int64]
    blocks: NDArray[np.int64]

    def thinned(self, most: int) -> Part:
        """At most `most` of the instances, evenly spread."""
        n = self.iids.size
        rows = np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.intp))
        return Part(self.iids[rows], self.blocks[rows])


def split_instances(store: Store, run: str, fitted: int, judged: int) -> tuple[Part, Part]:
    """At most `fitted` instances to fit on, and `judged` others to judge on.

    Blocks of neighbouring instances alternate between the parts, so that neighbours, which look
    alike, are in one part. Instances that the run's model was trained on are in neither. Raises
    InconclusiveError where there are too few.
    """
    iids = store.in_recording_order(population(store, run))
    if iids.size < MIN_INSTANCES:
        raise InconclusiveError(
            f"{store.path}: run {run} has {iids.size} instances that its model was not trained "
            f"on; a search needs {MIN_INSTANCES}"
        )
    trajectories = store.instances.trajectory[iids]
    length = max(1, min(int(np.ceil(np.sqrt(iids.size))), iids.size // (2 * _FEWEST_BLOCKS)))
    blocks = split_into_blocks(trajectories.astype(np.int64), length)
    number = np.repeat(np.arange(blocks.count), np.diff(blocks.start))
    parts = (Part(iids[number % 2 == odd], number[number % 2 == odd]) for odd in (0, 1))
    fit, judge = parts
    return fit.thinned(fitted), judge.thinned(judged)
