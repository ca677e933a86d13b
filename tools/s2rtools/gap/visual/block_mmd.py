"""The kernel distance of sim and real images of the same poses.

Instances are split in two halves of whole blocks, A and B, which see different poses: m is the
unbiased MMD^2 of the sim images of B and the real ones of A, averaged over all splits. Pairs of two
images of one block are left out throughout: neighbours are alike, which a distance of independent
samples would count as a gap, and bright sim images as a larger one than dark ones. That average has
a closed form, a sum over pairs of blocks: m = d' (SS + RR - 2 SR) d / d' N d with S, R the block
sums of the kernel, N the numbers of pairs and d all ones. Where sim and real images are identical,
as for the floor, every term of it is 0. Bootstrap replicates and permutations only change d, in
common for the blocks that are drawn as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.bootstrap import LEVEL
from s2rtools.gap.blocks import Blocks
from s2rtools.gap.bootstrap_correction import widened
from s2rtools.gap.visual.kid import polynomial_gram

Floats = NDArray[np.float64]

_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Paired:
    """`excess` (B, B): block sums SS + RR - 2 SR, `pairs` (B, B): their numbers; diagonals 0.

    `units` (B,) are codes 0, 1, ... of what is drawn as one.
    """

    excess: Floats
    pairs: Floats
    units: NDArray[np.int64]

    @property
    def blocks(self) -> int:
        return self.pairs.shape[0]

    def value(self) -> float:
        """NaN below 2 blocks."""
        total = self.pairs.sum()
        return float(self.excess.sum() / total) if total else float("nan")

    def replicates(self, counts: Floats, level: float = LEVEL) -> Floats:
        """Of bootstrap samples that hold block b `counts` (R, B) times, shape (R,).

        Copies of a unit make no pair with each other: the pair of an instance and itself would
        bias the distance, as would that of a block and itself. Pairs inside a unit come with each
        of its copies.
        """
        drawn = self._drawn(counts, self.excess) / self._drawn(counts, self.pairs)
        return widened(drawn, self.value(), self._count, level)

    def _drawn(self, counts: Floats, matrix: Floats) -> Floats:
        inside = np.where(self.units[:, None] == self.units, matrix, 0.0)
        return np.asarray(_quadratic(counts, matrix - inside) + counts @ inside.sum(axis=1))

    def swap_p(self, permutations: int, seed: int) -> float:
        """Permutation p-value: sim and real images of whole units change places.

        Exact for pairs where only neighbours depend on each other; d then holds signs. Where they
        are no more than `permutations`, all are tried once; 2^(1 - units) is the least there is.
        """
        count = self._count
        if 2 ** (count - 1) <= permutations:
            signs = _all_signs(count)
        else:
            draw = np.random.default_rng(seed).choice
            drawn = draw([-1.0, 1.0], (permutations, count))
            signs = np.concatenate([np.ones((1, count)), drawn], axis=0)
        observed = float(self.excess.sum())
        slack = 1e-9 * float(np.abs(self.excess).sum())
        return float((_quadratic(signs[:, self.units], self.excess) >= observed - slack).mean())

    @property
    def _count(self) -> int:
        return int(self.units.max()) + 1


def _all_signs(count: int) -> Floats:
    """Every choice of signs but for the common one, the observed one among them."""
    bits = np.arange(2 ** (count - 1))[:, None] >> np.arange(count) & 1
    return np.where(bits == 1, -1.0, 1.0)


def paired(sim: Floats, real: Floats, blocks: Blocks) -> Paired:
    """Of features (n, d) of both sides of the same instances, in recording order.

    What is of rounding size counts as 0.
    """
    own = _block_sums(sim, sim, blocks) + _block_sums(real, real, blocks)
    excess = own - 2 * _block_sums(sim, real, blocks)
    excess[np.abs(excess) < _ROUNDING * np.abs(own)] = 0.0
    pairs = np.outer(blocks.sizes, blocks.sizes)
    np.fill_diagonal(pairs, 0.0)
    return Paired(excess, pairs, blocks.units)


def _block_sums(x: Floats, y: Floats, blocks: Blocks) -> Floats:
    """Sums of the kernel over pairs of two blocks, symmetric (B, B) with a diagonal of 0."""
    sums = blocks.sums(blocks.sums(polynomial_gram(x, y)).T)
    sums = (sums + sums.T) / 2
    np.fill_diagonal(sums, 0.0)
    return sums


def _quadratic(rows: Floats, matrix: Floats) -> Floats:
    """d' M d of each row of (R, B), shape (R,)."""
    return np.einsum("ij,ij->i", rows @ matrix, rows)
