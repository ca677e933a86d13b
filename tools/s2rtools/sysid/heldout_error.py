"""Prediction error on held-out windows before and after identification.

Windows of one drive depend on each other, so the bootstrap resamples drives, with the correction
for few drives. Where there are fewer than 6 drives it also resamples blocks of consecutive windows
inside each drive, which widens the interval instead of the correction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.intervals import LEVEL
from s2rstore.metrics.bootstrap import circular_block_sums, percentile_bounds
from s2rtools.sysid.drive_bootstrap import drive_interval
from s2rtools.sysid.prediction_error import PredictionError
from s2rtools.sysid.simulators.simulator import Floats, Integers

_MIN_DRIVES = 6
"""Fewest drives that are resampled as a whole."""
_MAX_HEADING_RATIO = 1.02
"""Largest ratio of heading errors after and before that counts as no worse."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Root mean square position (m) and heading (rad) errors of the windows, and the mean
    `improvement` of a window's position error, m, with its bootstrap interval over drives.
    """

    drives: int
    windows: int
    untuned: tuple[float, float]
    fitted: tuple[float, float]
    improvement: float
    low: float
    high: float

    @property
    def helps(self) -> bool:
        """Whether positions improve significantly and headings do not get worse."""
        return self.low > 0 and self.fitted[1] <= _MAX_HEADING_RATIO * self.untuned[1]

    def record(self) -> dict[str, Any]:
        """JSON data with six significant digits."""
        figures = (*self.untuned, *self.fitted, self.improvement, self.low, self.high)
        u0, u1, f0, f1, improvement, low, high = (float(f"{value:.6g}") for value in figures)
        return {
            "drives": self.drives,
            "windows": self.windows,
            "untuned": {"place_m": u0, "heading_rad": u1},
            "fitted": {"place_m": f0, "heading_rad": f1},
            "improvement_m": improvement, "improvement_low": low, "improvement_high": high,
            "helps": self.helps,
        }  # fmt: skip


def held_out_error(problem: PredictionError, before: Floats, after: Floats, count: int,
                   rng: np.random.Generator) -> HeldOut:  # fmt: skip
    """Compare two sets of normalised parameters from the same start states."""
    replays = problem.windows.replays
    errors = []
    for cube in (before, after):
        deviations = problem.predicted(cube)[:, :3] - problem.windows.poses
        squares = np.stack([(deviations[:, :2] ** 2).sum(axis=1), deviations[:, 2] ** 2], axis=1)
        counts = np.diff(replays.first)[:, None]
        errors.append(np.sqrt(np.add.reduceat(squares, replays.first[:-1]) / counts))
    return compared(errors[0], errors[1], replays.drive, count, rng)


def compared(before: Floats, after: Floats, drives: Integers, count: int,
             rng: np.random.Generator) -> HeldOut:  # fmt: skip
    """Compare root mean square errors (w, 2), position and heading, of two predictions.

    `drives` (w,) are the drives of the windows, which are in recording order.
    """
    gain = before[:, 0] - after[:, 0]
    groups = [gain[drives == drive] for drive in np.unique(drives)]
    mean = float(gain.mean())
    replicates = grouped_mean_replicates(groups, count, rng)
    if len(groups) < _MIN_DRIVES:
        low, high = percentile_bounds(replicates)
    else:
        low, high = map(float, drive_interval(replicates, LEVEL, len(groups)))
    untuned, fitted = (np.sqrt((table**2).mean(axis=0)).tolist() for table in (before, after))
    return HeldOut(len(groups), len(gain), tuple(untuned), tuple(fitted), mean, low, high)


def grouped_mean_replicates(groups: list[Floats], count: int, rng: np.random.Generator) -> Floats:
    """Bootstrap replicates (count,) of the mean over windows, which are grouped by drive."""
    sizes = np.array([len(group) for group in groups])
    total, number = np.zeros(count), np.zeros(count)
    for _ in groups:
        chosen = rng.integers(0, len(groups), count)
        if len(groups) < _MIN_DRIVES:
            sums = np.stack([_block_sums(group, count, rng) for group in groups])
        else:
            sums = np.broadcast_to([[group.sum()] for group in groups], (len(groups), count))
        total += sums[chosen, np.arange(count)]
        number += sizes[chosen]
    return total / number


def _block_sums(values: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Sums (count,) of circular block resamples, scaled to the length of `values`."""
    n = len(values)
    length = int(np.ceil(np.sqrt(n)))
    parts = -(-n // length)
    starts = rng.integers(0, n, (count, parts))
    return circular_block_sums(values, length, starts) * (n / (parts * length))
