"""Errors, losses, accuracies and ranks of predicted poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.index.columns import RunColumns
from s2rstore.index.population import Population
from s2rstore.records import Side

LOSS_GAMMA = 0.3


def position_error(
    x: NDArray[np.float64], y: NDArray[np.float64], x0: NDArray[np.float64], y0: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance in metres, elementwise."""
    return np.asarray(np.hypot(x - x0, y - y0), dtype=np.float64)


def pose_loss(
    error: NDArray[np.float64], heading_error: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(1 - g) error^2 + g heading_error with g = 0.3 (Sim2RealViz, eq. 1), m^2 and rad."""
    return (1 - LOSS_GAMMA) * error**2 + LOSS_GAMMA * heading_error


def accuracy(error: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """max(0, 1 - error / scale), both in metres."""
    return np.maximum(0.0, 1.0 - error / scale)


def rank(error: NDArray[np.float64]) -> NDArray[np.int32]:
    """1 for the smallest error, ties by index; 0 where the error is NaN."""
    ranks = np.zeros(error.size, dtype=np.int32)
    known = np.flatnonzero(~np.isnan(error))
    ranks[known[np.argsort(error[known], kind="stable")]] = np.arange(1, known.size + 1)
    return ranks


def population_ranks(population: Population, run: RunColumns, side: Side) -> NDArray[np.int32]:
    """(N,) ranks by a side's error among the instances that count in any trajectory, else 0.

    Where all instances count, they are the stored ranks, which only pairs have.
    """
    part = run.side(side)
    if not population.leaves_out_trained(run):
        return part.rank
    return rank(np.where(run.trained | (part.rank == 0), np.nan, part.error))
