"""Exact Shapley values."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray


def shapley_values(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Exact Shapley values (players, ...) of the coalition values (2 ** players, ...).

    The index of a coalition has the bit 1 << i set where player i belongs to it. They sum to the
    value of all players minus that of none. Source: Shapley, "A value for n-person games", 1953.
    """
    count = int(np.log2(len(values)))
    if 1 << count != len(values):
        raise ValueError(f"{len(values)} coalitions: not a power of 2")
    index = np.arange(len(values))
    size = np.array([int(k).bit_count() for k in index])
    weight = np.array([1.0 / (count * comb(count - 1, s)) for s in range(count)])
    shares = []
    for player in range(count):
        without = index[(index >> player) & 1 == 0]
        difference = values[without | (1 << player)] - values[without]
        shares.append(np.tensordot(weight[size[without]], difference, axes=1))
    return np.stack(shares)
