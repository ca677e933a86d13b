"""Many instances as bands across the runs of the overview: quantiles of each run's accuracies."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from s2rtui.drawing.scale import Floats

MOST_LINES = 60
"""More instances than this, selected or not, are drawn as bands instead of lines."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""The ends of the outer and the inner band, and the median between them."""
BAND_TEXT = "5 to 95 %, 25 to 75 %, median"
_SPARSE = np.array([[1, 0], [0, 0], [0, 1], [0, 0]], dtype=np.bool_)
"""The dots of a cell that the outer band has."""


def accuracy_quantiles(
    columns: tuple[Floats, ...], members: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """`QUANTILES` of the known accuracies of `members` (N,), (runs, 5); NaN where none is known."""
    quantiles = np.full((len(columns), len(QUANTILES)), np.nan)
    for row, column in enumerate(columns):
        known = np.asarray(column, dtype=np.float64)[members]
        known = known[np.isfinite(known)]
        if known.size:
            quantiles[row] = np.quantile(known, QUANTILES)
    return quantiles


def binned_quantiles(counts: NDArray[np.intp]) -> NDArray[np.float64]:
    """`QUANTILES` of counts (runs, bins) as shares of the axis, (runs, 5); NaN without counts.

    Within a bin instances count as evenly spread.
    """
    size = counts.shape[1]
    edges = np.arange(size + 1) / size
    quantiles = np.full((len(counts), len(QUANTILES)), np.nan)
    for row, part in enumerate(counts):
        below = np.concatenate([[0], np.cumsum(part)])
        if below[-1]:
            quantiles[row] = np.interp(np.array(QUANTILES) * below[-1], below, edges)
    return quantiles


def band_density(
    quantiles: NDArray[np.float64], chart_width: int, step: int
) -> NDArray[np.float64]:
    """Bands between neighbouring runs as dots, (4 rows, 2 columns per cell of the chart).

    `quantiles` (runs, 5) are shares of the axis. The outer band has 1 in some of its dots, the
    inner one 2 and the median 3. Where a run has no quantiles, no band leads to it.
    """
    places = 2 * (0.5 + quantiles * (chart_width - 1))
    along = ((np.arange(4 * step) + 0.5) / (4 * step))[:, None]
    parts = [_between(first, second, along, 2 * chart_width) for first, second in pairwise(places)]
    edge = np.zeros((2, 2 * chart_width))
    grid = np.concatenate([edge, *parts, edge])
    sparse = np.tile(_SPARSE, (len(grid) // 4, chart_width))
    return np.where((grid == 1) & ~sparse, 0.0, grid)


def _between(
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    along: NDArray[np.float64],
    width: int,
) -> NDArray[np.float64]:
    """The dots of the bands from one run's places (5,) to the next one's, (rows, width)."""
    grid = np.zeros((len(along), width))
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return grid
    dots = np.floor(first + (second - first) * along)
    columns = np.arange(width)
    for level, (left, right) in enumerate(((0, 4), (1, 3), (2, 2)), start=1):
        inside = (columns >= dots[:, left, None]) & (columns <= dots[:, right, None])
        grid[inside] = level
    return grid
