"""Kernel distance between two sets of features: the unbiased squared MMD (KID).

Source: Binkowski et al., "Demystifying MMD GANs", 2018; Gretton et al., "A kernel two-sample test",
2012. All samples enter at once: averages over subsets only add noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

KERNEL = "(x.y / d + 1)^3"
_ROWS = 64


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


def permutation_p(x: Floats, y: Floats, permutations: int = 1000, seed: int = 1) -> float:
    """How often the KID of shuffled labels reaches the observed one, which counts as one of them.

    For independent samples. One Gram matrix of all serves every permutation: with labels as rows
    of a matrix, the three sums of each permutation come from one product.
    """
    pooled = np.concatenate([x, y])
    n, total = len(x), len(pooled)
    gram = polynomial_gram(pooled, pooled)
    np.fill_diagonal(gram, 0.0)
    rng = np.random.default_rng(seed)
    observed = np.zeros((1, total))
    observed[0, :n] = 1.0
    value = float(_labelled(gram, observed, n)[0])
    hits = 0
    for start in range(0, permutations, _ROWS):
        count = min(_ROWS, permutations - start)
        labels = rng.permuted(np.repeat(observed, count, axis=0), axis=1)
        hits += int((_labelled(gram, labels, n) >= value - _slack(value)).sum())
    return (1 + hits) / (1 + permutations)


def _labelled(gram: Floats, labels: Floats, n: int) -> Floats:
    """Unbiased MMD^2 (P,) of the labellings (P, N), n ones each; the diagonal of `gram` is 0."""
    m = gram.shape[0] - n
    ones = np.einsum("ij,ij->i", labels @ gram, labels)
    touching = labels @ gram.sum(axis=1)
    cross = touching - ones
    zeros = gram.sum() - touching - cross
    return np.asarray(ones / (n * (n - 1)) + zeros / (m * (m - 1)) - 2 * cross / (n * m))


def _slack(value: float) -> float:
    """Equal labellings differ by rounding only, and must count as equal."""
    return 1e-9 * max(abs(value), 1e-12)
