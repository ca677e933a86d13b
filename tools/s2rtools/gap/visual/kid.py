"""Kernel distance between two sets of features: the unbiased squared MMD (KID).

Source: Binkowski et al., "Demystifying MMD GANs", 2018; Gretton et al., "A kernel two-sample test",
2012. All samples enter at once: averages over subsets only add noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

KERNEL = "(x.y / d + 1)^3"


def polynomial_gram(x: Floats, y: Floats) -> Floats:
    """(x.y / d + 1)^3 for all pairs of (n, d) and (m, d); shape (n, m)."""
    return (x @ y.T / x.shape[1] + 1.0) ** 3


def mmd2(xx: Floats, yy: Floats, xy: Floats) -> float:
    """Unbiased squared MMD from the Gram matrices (n, n), (m, m), (n, m); may be below 0."""
    n, m = xy.shape
    if min(n, m) < 2:
        raise ValueError("the unbiased MMD needs 2 samples of each")
    within_x = (xx.sum() - np.trace(xx)) / (n * (n - 1))
    within_y = (yy.sum() - np.trace(yy)) / (m * (m - 1))
    return float(within_x + within_y - 2 * xy.mean())


def kernel_distance(x: Floats, y: Floats) -> float:
    """KID of features (n, d) and (m, d)."""
    return mmd2(polynomial_gram(x, x), polynomial_gram(y, y), polynomial_gram(x, y))
