"""Wasserstein distances of samples of equal size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

PROJECTIONS = 128
"""Random directions of a sliced distance."""


def wasserstein_by_dimension(x: Floats, y: Floats) -> Floats:
    """Wasserstein-1 distance in each dimension of two samples (n, d), shape (d,), in their unit.

    Of samples of equal size it is the mean difference of the sorted values.
    """
    return np.asarray(np.abs(np.sort(x, axis=0) - np.sort(y, axis=0)).mean(axis=0))


def sliced_wasserstein(x: Floats, y: Floats, seed: int = 1) -> float:
    """Mean Wasserstein-1 distance over directions drawn uniformly from the sphere.

    Source: Bonneel et al., "Sliced and Radon Wasserstein barycenters of measures", 2015.
    """
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(x.shape[1], PROJECTIONS))
    directions /= np.linalg.norm(directions, axis=0)
    return float(wasserstein_by_dimension(x @ directions, y @ directions).mean())
