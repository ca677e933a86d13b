"""Independent units of windows: whole drives, or blocks of neighbouring windows of one drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval, of_units
from s2rtools.motion_logs.motion_log import Floats


class WindowUnits:
    """The units of the windows of some drives; each statistic is computed without each of them.

    Several drives are units as a whole. One drive is cut into contiguous blocks of windows that are
    at least as long as the windows that overlap each other.
    """

    def __init__(self, counts: Sequence[int], longest: int) -> None:
        """`counts`: windows of each drive; `longest`: windows that the longest one overlaps."""
        self.drives = len(counts)
        self._edges: NDArray[np.intp] = np.zeros(1, dtype=np.intp)
        if self.drives == 1:
            length = max(1, longest, int(np.ceil(np.sqrt(counts[0]))))
            blocks = max(1, counts[0] // length)
            self._edges = np.arange(blocks) * counts[0] // blocks
        self.count = self.drives if self.drives > 1 else self._edges.size
        self.unit = "drives" if self.drives > 1 else "blocks of windows"

    def means(self, values: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Mean over the windows of all drives (H,), and without each unit (H, G).

        `values` holds (H, K) per drive, NaN where there is no window.
        """
        sums = self._sums([np.nan_to_num(table) for table in values])
        counts = self._sums([np.isfinite(table).astype(np.float64) for table in values])
        mean = sums.sum(axis=1) / np.maximum(counts.sum(axis=1), 1)
        others = counts.sum(axis=1, keepdims=True) - counts
        with np.errstate(divide="ignore", invalid="ignore"):
            left_out = (sums.sum(axis=1, keepdims=True) - sums) / others
        return mean, np.where(others > 0, left_out, np.nan)

    def drive_means(self, values: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Weighted mean (H,) of one value per drive (drives, H), and without each unit (H, G)."""
        total = weights @ values / weights.sum()
        if self.drives == 1:
            return total, np.repeat(total[:, None], self.count, axis=1)
        rest = weights.sum() - weights
        return total, (weights @ values - weights[:, None] * values).T / rest

    def interval(self, value: float, left_out: Floats, level: float) -> Interval:
        """The interval of a statistic from its values (G,) without each unit."""
        return of_units(value, left_out, unit=self.unit, level=level)

    def _sums(self, values: Sequence[Floats]) -> Floats:
        """Sums (H, G) over the windows of each unit."""
        if self.drives > 1:
            return np.stack([table.sum(axis=1) for table in values], axis=1)
        return np.asarray(np.add.reduceat(values[0], self._edges, axis=1))
