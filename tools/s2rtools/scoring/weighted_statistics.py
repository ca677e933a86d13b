"""Statistics of weighted rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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
