"""The instances of the fit and those of the judgement: whole trajectories, or blocks of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rstore.intervals import Interval, paired_difference, simultaneous_level
from s2rstore.metrics.run_metrics import population
from s2rstore.reader import Store
from s2rtools.common.blocks import Blocks, split_into_blocks

MIN_INSTANCES = 16
"""Fewest new instances of a search."""
_FEWEST_BLOCKS = 6


@dataclass(frozen=True, slots=True, eq=False)
class SplitPart:
    """Instances in recording order: `iids` (n,), and the codes (n,) of trajectory and unit of each.

    Units are what `split_instances` divides by: trajectories, else blocks of neighbours.
    """

    iids: NDArray[np.int64]
    trajectory: NDArray[np.int64]
    units: NDArray[np.int64]

    @property
    def unit_blocks(self) -> Blocks:
        """The rows of each unit as one block."""
        return split_into_blocks(self.units, self.iids.size)

    def mean(self, differences: NDArray[np.float64], compared: int = 1) -> Interval:
        """The mean of paired differences (n,) of the instances, for `compared` of them at once."""
        level = simultaneous_level(compared)
        return paired_difference(differences, self.trajectory, level=level)

    def share_of_decrease(
        self, before: NDArray[np.float64], after: NDArray[np.float64], compared: int = 1
    ) -> Interval:
        """By which share of its mean a cost falls from `before` (n,) to `after` (n,).

        The interval is that of a ratio of means, by its linear terms; its level holds for
        `compared` shares at once. It is unknown where the cost before is 0.
        """
        mean = float(before.mean())
        if mean == 0:
            return Interval.unknown(reason="the images do not differ")
        share = float((before - after).mean()) / mean
        return self.mean((before - after - share * before) / mean + share, compared)

    def thinned(self, most: int) -> SplitPart:
        """At most `most` of the instances, evenly spread."""
        n = self.iids.size
        rows = np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.intp))
        return SplitPart(self.iids[rows], self.trajectory[rows], self.units[rows])


def split_instances(
    store: Store, run: str, fitted: int, judged: int
) -> tuple[SplitPart, SplitPart]:
    """Parts, as of `split`, of the instances that the run's model was not trained on.

    Raises InconclusiveError where there are too few.
    """
    iids = population(store, run)
    return split(store, iids, fitted, judged, f"run {run} has # that its model was not trained on")


def split(
    store: Store, members: NDArray[np.bool_], fitted: int, judged: int, text: str
) -> tuple[SplitPart, SplitPart]:
    """At most `fitted` of the `members` (N,) to fit on, and `judged` others to judge on.

    Where there are enough trajectories, by the rule of `Blocks.by_trajectory`, each of them is in
    one part. Else blocks of neighbouring instances alternate between the parts, so that neighbours,
    which look alike, are in one part. Raises InconclusiveError where there are too few; `text` says
    so, with `#` in place of the number of instances.
    """
    iids = store.in_recording_order(members)
    if iids.size < MIN_INSTANCES:
        counted_text = text.replace("#", f"{iids.size} instances")
        raise InconclusiveError(f"{store.path}: {counted_text}; a search needs {MIN_INSTANCES}")
    trajectories = store.instances.trajectory[iids].astype(np.int64)
    length = max(1, min(int(np.ceil(np.sqrt(iids.size))), iids.size // (2 * _FEWEST_BLOCKS)))
    blocks = split_into_blocks(trajectories, length)
    if blocks.by_trajectory:
        units, is_fit = trajectories, np.isin(trajectories, _fitted_trajectories(trajectories))
    else:
        units = np.repeat(np.arange(blocks.count), np.diff(blocks.start))
        is_fit = units % 2 == 0
    fit, judge = (
        SplitPart(iids[chosen], trajectories[chosen], units[chosen]) for chosen in (is_fit, ~is_fit)
    )
    return fit.thinned(fitted), judge.thinned(judged)


def _fitted_trajectories(trajectories: NDArray[np.int64]) -> list[int]:
    """Half of the trajectories with about half of the rows; of an odd number, the smaller half.

    `trajectories` (n,) are the codes of the rows. Of each two trajectories of similar length one
    is fitted: the longer one where the fitted ones have fewer rows so far.
    """
    codes, rows = np.unique(trajectories, return_counts=True)
    by_length = np.argsort(-rows, kind="stable")
    fitted: list[int] = []
    surplus = 0
    for longer, shorter in zip(by_length[0::2], by_length[1::2], strict=False):
        chosen, other = (shorter, longer) if surplus > 0 else (longer, shorter)
        surplus += int(rows[chosen] - rows[other])
        fitted.append(int(codes[chosen]))
    return fitted
