"""Mean errors, gap and relative drop of groups of instances, with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import LEVEL, Interval, paired_difference, ratio_of_means

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class GroupErrors:
    """Errors (n,) of the same instances in recording order, in metres, and their trajectories.

    `constant` is the error of the constant prediction of the mean position, on sim images.
    """

    sim: Floats
    real: Floats
    constant: Floats
    trajectory: NDArray[np.integer]

    @property
    def gap(self) -> Floats:
        return self.real - self.sim

    def of(self, rows: NDArray[np.bool_]) -> GroupErrors:
        """The errors of some rows (n,)."""
        return GroupErrors(
            self.sim[rows], self.real[rows], self.constant[rows], self.trajectory[rows]
        )

    def mean_gap(self, level: float = LEVEL) -> Interval:
        """The mean of real error - sim error."""
        return paired_difference(self.gap, self.trajectory, level=level)

    def relative_drop(self, level: float = LEVEL) -> Interval:
        """The mean gap as a share of the mean sim error; unknown where that is 0."""
        if not self.sim.mean() > 0:
            return Interval.unknown(reason="the sim error is 0")
        return ratio_of_means(self.real, self.sim, self.trajectory, level=level).scaled(1, -1)


def group_metrics(
    errors: GroupErrors, codes: NDArray[np.integer], names: Sequence[str], level: float
) -> dict[str, dict[str, Any]]:
    """Metrics by name of the group: n, mean errors, gap and relative drop with their intervals.

    `baseline` is the mean error of the constant prediction. `codes` (n,) index `names`; other codes
    belong to no group.
    """
    metrics = {}
    for code, name in enumerate(names):
        rows = codes == code
        if not rows.any():
            continue
        group = errors.of(rows)
        metrics[name] = {
            "n": int(group.sim.size),
            "sim": float(group.sim.mean()),
            "real": float(group.real.mean()),
            "baseline": float(group.constant.mean()),
            "gap": group.mean_gap(level).as_json(),
            "relative_drop": group.relative_drop(level).as_json(),
        }
    return metrics
