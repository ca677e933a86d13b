"""How well values separate positives, with ties broken by seeded noise; weighted statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TOP_SHARE = 0.05


@dataclass(frozen=True, slots=True)
class RankedCells:
    """Cells in ascending order of their value; NaN ranks as the median.

    Source of the area: Mann and Whitney, 1947.
    """

    order: NDArray[np.intp]
    positive: NDArray[np.bool_]

    @classmethod
    def of(
        cls, values: NDArray[np.floating], positive: NDArray[np.bool_], rng: np.random.Generator
    ) -> RankedCells:
        """Rank `values`, with labels `positive` of equal size; `rng` breaks ties."""
        flat = np.asarray(values, dtype=np.float64).ravel()
        known = np.isfinite(flat)
        flat = np.where(known, flat, np.median(flat[known]) if known.any() else 0.0)
        order = np.lexsort((rng.random(flat.size), flat))
        return cls(order, positive.ravel()[order])

    def auroc(self, weights: NDArray[np.float64] | None = None) -> float:
        """Probability that a positive cell ranks above a negative one; NaN without either."""
        w = np.ones(self.order.size) if weights is None else weights[self.order]
        pos, neg = np.where(self.positive, w, 0.0), np.where(self.positive, 0.0, w)
        below = np.cumsum(neg) - neg
        pairs = pos.sum() * neg.sum()
        return float((pos * below).sum() / pairs) if pairs > 0 else float("nan")

    def precision(
        self, top: float = TOP_SHARE, weights: NDArray[np.float64] | None = None
    ) -> float:
        """Share of positives among the `top` share of cells."""
        w = np.ones(self.order.size) if weights is None else weights[self.order]
        w, positive = w[::-1], self.positive[::-1]
        selected = np.clip(top * w.sum() - (np.cumsum(w) - w), 0.0, w)
        total = selected.sum()
        return float((selected * positive).sum() / total) if total > 0 else float("nan")


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
