"""Precision, recall, density and coverage of two sets of features, from nearest neighbours.

Source: Kynkaanniemi et al., "Improved precision and recall metric", 2019 (precision, recall);
Naeem et al., "Reliable fidelity and diversity metrics", 2020 (density, coverage).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NEIGHBOURS = 5


@dataclass(frozen=True, slots=True)
class Prdc:
    """Shares in [0, 1], except density, which may exceed 1.

    precision: share of `sim` points inside the balls of `real`; recall: the reverse; density:
    number of `real` balls around a sim point, over k; coverage: share of `real` balls that contain
    a sim point. A ball reaches to the k-th nearest neighbour of its centre.
    """

    precision: float
    recall: float
    density: float
    coverage: float


def prdc(real: Floats, sim: Floats, neighbours: int = NEIGHBOURS) -> Prdc:
    """Compare features (n, d) and (m, d) with Euclidean balls."""
    if min(len(real), len(sim)) <= neighbours:
        raise ValueError(f"{neighbours} neighbours need {neighbours + 1} samples of each")
    across = _distances(real, sim)
    real_radius = _radius(real, neighbours)
    sim_radius = _radius(sim, neighbours)
    inside = across <= real_radius[:, None]
    return Prdc(
        precision=float(inside.any(axis=0).mean()),
        recall=float((across <= sim_radius[None, :]).any(axis=1).mean()),
        density=float(inside.sum(axis=0).mean() / neighbours),
        coverage=float(inside.any(axis=1).mean()),
    )


def _radius(points: Floats, neighbours: int) -> Floats:
    """Squared distance (n,) of each point to its k-th nearest neighbour."""
    return np.partition(_distances(points, points), neighbours, axis=1)[:, neighbours]


def _distances(x: Floats, y: Floats) -> Floats:
    """Squared Euclidean distances (n, m); those of the size of rounding errors are set to 0."""
    xx, yy = np.einsum("ij,ij->i", x, x), np.einsum("ij,ij->i", y, y)
    squares = xx[:, None] + yy[None, :] - 2 * x @ y.T
    squares[squares < 1e-12 * (xx[:, None] + yy[None, :])] = 0.0
    return squares
