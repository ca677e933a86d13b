"""Resamples of windows: neighbouring windows stay together, and so do those of a drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from s2rtools.gap.contract import Settings
from s2rtools.logs.contract import Floats


def small_sample(parts: int, level: float) -> float:
    """b parts know no more than b values: sqrt(b / (b - 1)), and Student's t for normal."""
    if parts < 2:
        return float("nan")
    tail = 0.5 * (1 + level)
    student = stats.t.ppf(tail, parts - 1) / stats.norm.ppf(tail)
    return float(np.sqrt(parts / (parts - 1)) * student)


def bounds(replicates: Floats, level: float) -> list[float]:
    """The percentile interval."""
    return [float(v) for v in np.percentile(replicates, [50 * (1 - level), 50 * (1 + level)])]


MIN_DRIVES = 5
"""From how many on drives alone are resampled."""


def drawn_drives(drives: int, rng: np.random.Generator, replicates: int) -> Floats:
    """How often each of several drives (at least 2) is drawn, (R, G)."""
    draws = rng.multinomial(drives, np.full(drives, 1 / drives), replicates)
    return np.asarray(draws, dtype=np.float64)


class Blocks:
    """One set of resamples, to be applied to everything that was measured on the same windows.

    One drive is resampled by circular blocks of its windows; two to four as drives, and by blocks
    inside, which is rather too wide than too narrow; five and more as drives.
    """

    def __init__(self, counts: Sequence[int], longest: int, settings: Settings) -> None:
        """`counts` are the windows of each drive, `longest` how many the longest one overlaps."""
        rng = np.random.default_rng(settings.seed)
        drives = len(counts)
        self._lengths: list[int] = []
        self._starts: list[NDArray[np.int64]] = []
        for count in counts:
            length = max(1, min(max(longest, int(np.ceil(np.sqrt(count)))), count // 2))
            blocks = -(-count // length)
            self._lengths.append(length)
            self._starts.append(rng.integers(0, count, (settings.replicates, blocks)))
        self.drawn = np.ones((settings.replicates, drives))
        self.widening = 1.0
        if drives > 1:
            self.drawn = drawn_drives(drives, rng, settings.replicates)
        self._inside = drives < MIN_DRIVES
        if drives == 1 or not self._inside:
            parts = drives if drives > 1 else self._starts[0].shape[1]
            self.widening = small_sample(parts, settings.level)

    def means(self, values: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Mean over the windows of all drives (H,), and of every resample (H, R).

        `values` holds (H, K) per drive, NaN where there is no window. Resampled values are not
        yet widened.
        """
        sums = [np.nansum(v, axis=1) for v in values]
        known = [np.isfinite(v).sum(axis=1) for v in values]
        mean = np.sum(sums, axis=0) / np.maximum(np.sum(known, axis=0), 1)
        above = np.zeros((len(mean), len(self.drawn)))
        below = np.zeros_like(above)
        for drive, table in enumerate(values):
            times = self.drawn[:, drive]
            above += times * self._totals(drive, np.nan_to_num(table))
            below += times * self._totals(drive, np.isfinite(table).astype(np.float64))
        unknown = below <= 0
        return mean, np.where(unknown, mean[:, None], above / np.where(unknown, 1.0, below))

    def widened(self, value: float, replicates: Floats) -> Floats:
        """Replicates (R,), 0 or more, spread as far as so few parts leave the value unknown."""
        return np.maximum(value + (replicates - value) * self.widening, 0.0)

    def _totals(self, drive: int, table: Floats) -> Floats:
        """Sums (H, R) of the drive's resampled blocks, or (H, 1) where it stays whole."""
        if not self._inside:
            return np.asarray(table.sum(axis=1, keepdims=True))
        length = self._lengths[drive]
        around = np.concatenate([table, table[:, : length - 1]], axis=1)
        total = np.cumsum(np.pad(around, ((0, 0), (1, 0))), axis=1)
        sums = total[:, length:] - total[:, :-length]
        return np.asarray(sums[:, self._starts[drive]].sum(axis=2))
