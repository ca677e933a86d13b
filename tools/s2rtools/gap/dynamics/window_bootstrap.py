"""Resamples of windows: neighbouring windows stay together, and so do those of a drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rtools.gap import bootstrap_correction
from s2rtools.gap.axis_result import GapSettings
from s2rtools.motion_logs.motion_log import Floats

_DRIVES = 7
"""Of the stream of random numbers that draws drives, whatever the axis."""


def drawn_drives(drives: int, settings: GapSettings) -> Floats:
    """How often each of several drives is drawn, (R, G); row r is the same for every axis."""
    rng = np.random.default_rng([settings.seed, _DRIVES])
    draws = rng.multinomial(drives, np.full(drives, 1 / drives), settings.replicates)
    return np.asarray(draws, dtype=np.float64)


class Resamples:
    """One set of resamples, to be applied to everything that was measured on the same windows.

    One drive is resampled by circular blocks of its windows, two and more as drives. Of 3000
    simulated sets of 2 to 8 drives whose gaps differ by 30 %, 0.92 to 0.94 had the truth inside the
    95 % interval of the root mean square, and 0.93 to 0.95 inside that of a mean.
    """

    def __init__(self, counts: Sequence[int], longest: int, settings: GapSettings) -> None:
        """`counts` are the windows of each drive, `longest` how many the longest one overlaps."""
        self._length = 0
        self._starts: NDArray[np.int64] = np.zeros((settings.replicates, 0), np.int64)
        parts = len(counts)
        self.drawn = drawn_drives(parts, settings)
        if parts == 1:
            count = counts[0]
            self._length = max(1, min(max(longest, int(np.ceil(np.sqrt(count)))), count // 2))
            parts = -(-count // self._length)
            rng = np.random.default_rng(settings.seed)
            self._starts = rng.integers(0, count, (settings.replicates, parts))
        self._parts, self._level = parts, settings.level

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
            above += times * self._totals(np.nan_to_num(table))
            below += times * self._totals(np.isfinite(table).astype(np.float64))
        unknown = below <= 0
        return mean, np.where(unknown, mean[:, None], above / np.where(unknown, 1.0, below))

    def widened(self, value: Floats, replicates: Floats) -> Floats:
        """Replicates (..., R) of a value (...), spread as far as so few parts leave it unknown."""
        return bootstrap_correction.widened(
            replicates, np.asarray(value)[..., None], self._parts, self._level
        )

    def _totals(self, table: Floats) -> Floats:
        """Sums (H, R) of the only drive's resampled blocks, or (H, 1) where drives stay whole."""
        if not self._length:
            return np.asarray(table.sum(axis=1, keepdims=True))
        length = self._length
        around = np.concatenate([table, table[:, : length - 1]], axis=1)
        total = np.cumsum(np.pad(around, ((0, 0), (1, 0))), axis=1)
        sums = total[:, length:] - total[:, :-length]
        return np.asarray(sums[:, self._starts].sum(axis=2))
