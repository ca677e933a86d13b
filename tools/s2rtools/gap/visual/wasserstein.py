"""Wasserstein-1 distances of features: of every dimension, and of seeded projections.

Source: Bonneel et al., "Sliced and Radon Wasserstein barycenters of measures", 2015.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PROJECTIONS = 128


def wasserstein_by_dimension(x: Floats, y: Floats) -> Floats:
    """The distance in each dimension of (n, d) and (m, d), shape (d,), in the features' unit.

    Of equal n it is the mean difference of the sorted values; else the area between the two
    distribution functions.
    """
    if min(len(x), len(y)) < 1:
        raise ValueError("the Wasserstein distance needs a sample of each")
    a, b = np.sort(x, axis=0), np.sort(y, axis=0)
    if len(a) == len(b):
        return np.asarray(np.abs(a - b).mean(axis=0))
    edges = np.union1d(np.arange(len(a) + 1) / len(a), np.arange(len(b) + 1) / len(b))
    middle = (edges[1:] + edges[:-1]) / 2
    rows = (middle * len(a)).astype(int), (middle * len(b)).astype(int)
    return np.asarray(np.diff(edges) @ np.abs(a[rows[0]] - b[rows[1]]))


def sliced_wasserstein(
    x: Floats, y: Floats, projections: int = PROJECTIONS, seed: int = 1
) -> float:
    """Mean distance over directions drawn uniformly from the sphere."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(x.shape[1], projections))
    directions /= np.linalg.norm(directions, axis=0)
    return float(wasserstein_by_dimension(x @ directions, y @ directions).mean())
