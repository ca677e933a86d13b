"""How far few independent parts (blocks, drives) leave a figure unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from s2rstore.metrics.bootstrap import LEVEL

Floats = NDArray[np.float64]


def small_sample(parts: int | Floats, level: float = LEVEL) -> Floats:
    """By what bootstrap deviations over b parts are too small; NaN below 2, elementwise.

    sqrt(b / (b - 1)), because b parts know no more than b values, times Student's quantile at b - 1
    degrees of freedom over the normal one.
    """
    b = np.asarray(parts, dtype=np.float64)
    known, tail = np.maximum(b, 2), (1 + level) / 2
    factor = np.sqrt(known / (known - 1)) * stdtrit(known - 1, tail) / ndtri(tail)
    return np.asarray(np.where(b > 1, factor, np.nan))


def widened(
    replicates: Floats, value: float | Floats, parts: int | Floats, level: float = LEVEL
) -> Floats:
    """Replicates (R, ...) about `value`, drawn apart as far as few parts leave it unknown."""
    return np.asarray(value + (replicates - value) * small_sample(parts, level))
