"""Distances of two sets of features: FID, precision and recall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NEIGHBOURS = 5


def frechet_distance(x: Floats, y: Floats) -> float:
    """|mu_x - mu_y|^2 + tr(S_x + S_y - 2 (S_x S_y)^(1/2)) of features (n, d) and (m, d).

    Features are modelled as Gaussians (FID; Heusel et al., "GANs trained by a two time-scale update
    rule", 2017). Covariances divide by n - 1. Where n + m < 2 d the root comes from
    `trace_root_of_samples`.
    """
    if min(len(x), len(y)) < 2:
        raise ValueError("the Frechet distance needs 2 samples of each")
    mean_x, mean_y = x.mean(axis=0), y.mean(axis=0)
    a = (x - mean_x) / np.sqrt(len(x) - 1)
    b = (y - mean_y) / np.sqrt(len(y) - 1)
    shift = float(np.sum((mean_x - mean_y) ** 2))
    spread = float(np.sum(a * a) + np.sum(b * b))
    if len(x) + len(y) < 2 * x.shape[1]:
        root = trace_root_of_samples(a, b)
    else:
        root = trace_root(a.T @ a, b.T @ b)
    return shift + spread - 2 * root


def trace_root(s: Floats, t: Floats) -> float:
    """tr((S T)^(1/2)) of positive semidefinite S, T (d, d), by symmetric eigendecompositions.

    S T has the eigenvalues of the symmetric S^(1/2) T S^(1/2), so the trace is the sum of their
    roots; values below 0 are rounding and count as 0.
    """
    values, vectors = np.linalg.eigh(s)
    root = (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T
    inner = root @ t @ root
    eigenvalues = np.linalg.eigvalsh((inner + inner.T) / 2)
    return float(np.sqrt(np.maximum(eigenvalues, 0)).sum())


def trace_root_of_samples(a: Floats, b: Floats) -> float:
    """tr((A'A B'B)^(1/2)) of A (n, d), B (m, d): the nuclear norm of A B' (n, m), fast for n < d.

    A'A B'B = A' (A B' B) has the nonzero eigenvalues of (A B' B) A' = (A B')(A B')', which are the
    squared singular values of A B'; the trace of the root is their plain sum.
    """
    return float(np.linalg.svd(a @ b.T, compute_uv=False).sum())


@dataclass(frozen=True, slots=True)
class Prdc:
    """Precision, recall, density and coverage: shares, except density, which may exceed 1.

    precision: share of `sim` points inside the balls of `real`; recall: the reverse; density:
    number of `real` balls around a sim point, over k; coverage: share of `real` balls that contain
    a sim point. A ball reaches to the k-th nearest neighbour of its centre. Source: Kynkaanniemi et
    al., "Improved precision and recall metric", 2019; Naeem et al., "Reliable fidelity and
    diversity metrics", 2020.
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
