"""Bootstrap intervals of statistics of weighted rows, over blocks of neighbouring views."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics import bootstrap
from s2rstore.metrics.bootstrap import Blocks, BootstrapSettings, Interval

SETTINGS = BootstrapSettings(replicates=400)

Floats = NDArray[np.float64]
Statistics = Callable[[Floats], Sequence[float]]
"""Values of some statistics, where row k counts `weights[k]` times."""


def block_intervals(
    statistics: Statistics,
    view: NDArray[np.intp],
    trajectory: NDArray[np.integer],
    settings: BootstrapSettings = SETTINGS,
) -> list[Interval]:
    """95 % percentile interval of each statistic of K rows.

    `view` (K,) are rows of `trajectory` (V,), the codes of the views' trajectories in recording
    order, equal ones adjacent. Blocks of views are resampled with all of their rows.
    """
    blocks = bootstrap.split_into_blocks(trajectory, settings.block_length)
    block_of_view = np.repeat(np.arange(blocks.count), np.diff(blocks.start))
    return resampled_intervals(statistics, block_of_view[view], blocks, settings)


def resampled_intervals(
    statistics: Statistics, block: NDArray[np.intp], blocks: Blocks, settings: BootstrapSettings
) -> list[Interval]:
    """Percentile interval of each statistic of K rows, corrected for few units.

    `block` (K,) is the block of each row. Replicates in which a statistic is undefined are left
    out; bounds are NaN for fewer than two units.
    """
    values = list(statistics(np.ones(block.size)))
    if blocks.unit_count < 2:
        return [Interval.unknown(value) for value in values]
    drawn = [statistics(counts[block]) for counts in bootstrap.block_counts(blocks, settings)]
    made = bootstrap.corrected(np.array(drawn), np.array(values), blocks.unit_count, settings.level)
    return [
        bootstrap.percentile_interval(value, column[np.isfinite(column)], settings.level)
        for value, column in zip(values, made.T, strict=True)
    ]


def weighted_mean(values: NDArray[np.generic], weights: Floats | None = None) -> float:
    """Mean of values (K,), each `weights` times present; NaN without any."""
    w = np.ones(values.shape) if weights is None else weights
    total = float(w.sum())
    return float((w * values.astype(np.float64)).sum() / total) if total > 0 else float("nan")


def weighted_pearson(a: Floats, b: Floats, weights: Floats) -> float:
    """Correlation of two columns (K,), each row `weights` times present; NaN for constants."""
    total = float(weights.sum())
    if not total > 0:
        return float("nan")
    x, y = a - (weights @ a) / total, b - (weights @ b) / total
    spread_x, spread_y = weights @ (x * x), weights @ (y * y)
    least = 1e-18 * total
    if spread_x <= least or spread_y <= least:
        return float("nan")
    return float((weights @ (x * y)) / np.sqrt(spread_x * spread_y))
