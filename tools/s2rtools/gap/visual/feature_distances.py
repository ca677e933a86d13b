"""Distances of two sets of features: KID, FID, precision and recall; KID of paired sets.

KID is the unbiased squared MMD. `kernel_distance` compares two independent sets. All samples enter
at once: averages over subsets would only add noise.

`BlockMMD` compares sim and real images of the same poses. The instances are split into two halves
of whole blocks, A and B, that show different poses; the measure is the MMD^2 of the sim images of B
and the real images of A, averaged over all splits. Pairs of images of one block are left out,
because neighbouring images are alike and would count as a gap. The average has a closed form, a sum
over pairs of blocks: d' (SS + RR - 2 SR) d / d' N d, with S and R the block sums of the kernel, N
the numbers of pairs and d all ones. Where sim and real images are identical every term is 0.
Permutations change only d.

Source: Binkowski et al., "Demystifying MMD GANs", 2018; Gretton et al., "A kernel two-sample test",
2012.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import LEVEL, Interval, linear
from s2rtools.common.blocks import Blocks

Floats = NDArray[np.float64]

KERNEL = "(x.y / d + 1)^3"
_ROUNDING = 1e-12
NEIGHBOURS = 5


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


@dataclass(frozen=True, slots=True, eq=False)
class BlockMMD:
    """Kernel sums of n instances in B blocks.

    `excess` (B, B) is SS + RR - 2 SR of two blocks, with a diagonal of 0. `sums` (n,) are the sums
    of each instance over those of other blocks, `pairs` (n,) their numbers.
    """

    excess: Floats
    sums: Floats
    pairs: Floats
    blocks: Blocks

    def value(self) -> float:
        """NaN below 2 blocks."""
        total = self.pairs.sum()
        return float(self.sums.sum() / total) if total else float("nan")

    def interval(self, level: float = LEVEL) -> Interval:
        """Return the distance with an interval that rests on the influence of each instance."""
        value, sizes = self.value(), np.diff(self.blocks.start)
        if not self.sums.any():  # sim and real images are identical
            return Interval(0.0, 0.0, 0.0, level)
        influence = 2 * (self.sums - value * self.pairs) / self.pairs.mean()
        return linear(value, influence, np.repeat(self.blocks.trajectory, sizes), level=level)

    def swap_p(self, permutations: int, seed: int) -> float:
        """Permutation p-value: the sim and real images of whole units are exchanged.

        Exact for pairs of which only neighbours depend on each other; d then holds signs. All
        permutations are tried where there are at most `permutations`; the smallest possible value
        is 2^(1 - units).
        """
        units = self.blocks.units
        count = int(units.max()) + 1
        if 2 ** (count - 1) <= permutations:
            signs = _all_signs(count)
        else:
            draw = np.random.default_rng(seed).choice
            drawn = draw([-1.0, 1.0], (permutations, count))
            signs = np.concatenate([np.ones((1, count)), drawn], axis=0)
        observed = float(self.excess.sum())
        slack = 1e-9 * float(np.abs(self.excess).sum())
        return float((_quadratic(signs[:, units], self.excess) >= observed - slack).mean())


def _all_signs(count: int) -> Floats:
    """All sign vectors up to a common sign; the first is the observed one."""
    bits = np.arange(2 ** (count - 1))[:, None] >> np.arange(count) & 1
    return np.where(bits == 1, -1.0, 1.0)


def block_mmd(sim: Floats, real: Floats, blocks: Blocks) -> BlockMMD:
    """Kernel sums for features (n, d) of both sides of the same instances, in recording order.

    Sums of the size of rounding errors count as 0.
    """
    within = polynomial_gram(sim, sim) + polynomial_gram(real, real)
    across = polynomial_gram(sim, real)
    kernel = within - across - across.T
    kernel[np.abs(kernel) < _ROUNDING * np.abs(within)] = 0.0
    to_blocks = blocks.sums(kernel).T  # (n, B)
    own = np.repeat(np.arange(blocks.count), np.diff(blocks.start))
    to_blocks[np.arange(own.size), own] = 0.0
    return BlockMMD(
        blocks.sums(to_blocks), to_blocks.sum(axis=1), own.size - blocks.sizes[own], blocks
    )


def _quadratic(rows: Floats, matrix: Floats) -> Floats:
    """d' M d for each row d of (R, B), shape (R,)."""
    return np.einsum("ij,ij->i", rows @ matrix, rows)


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
